"""Rows of a PNG as they were before its filters.

Source: PNG specification, third edition (W3C), section 9.
"""

import numpy as np

from hsslam_node.kernels.compiled import njit

_NONE, _SUB, _UP, _AVERAGE, _PAETH = range(5)


@njit(cache=True, nogil=True, error_model="numpy")
def unfilter(rows, step, out):
    """Write the bytes of pixels; False: a row has a filter that there is not.

    Args:
        rows: [H, 1 + N] uint8, each the number of its filter, then N bytes.
        step: bytes of a pixel.
        out: [H, N] uint8.
    """
    height, width = out.shape
    zeros = np.zeros(width, np.uint8)
    for r in range(height):
        kind, row, here = rows[r, 0], rows[r, 1:], out[r]
        above = zeros if r == 0 else out[r - 1]
        if kind == _NONE:
            for i in range(width):
                here[i] = row[i]
        elif kind == _SUB:
            for i in range(step):
                here[i] = row[i]
            for i in range(step, width):
                here[i] = row[i] + here[i - step]
        elif kind == _UP:
            for i in range(width):
                here[i] = row[i] + above[i]
        elif kind == _AVERAGE:
            for i in range(step):
                here[i] = row[i] + (above[i] >> 1)
            for i in range(step, width):
                here[i] = row[i] + ((np.int32(here[i - step]) + np.int32(above[i])) >> 1)
        elif kind == _PAETH:
            for channel in range(step):
                _unfilter_paeth(row, above, channel, step, here)
        else:
            return False
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _unfilter_paeth(row, above, first, step, here):
    """Every `step`-th byte from `first` on: plus the one of left, above, and above left that fits best."""
    left = above_left = np.int32(0)
    for i in range(first, len(here), step):
        up = np.int32(above[i])
        from_left, from_up = abs(up - above_left), abs(left - above_left)
        from_both = abs(left + up - 2 * above_left)
        best = up if from_up < from_left else left
        best = above_left if from_both < min(from_left, from_up) else best
        left = (np.int32(row[i]) + best) & np.int32(255)
        above_left = up
        here[i] = left
