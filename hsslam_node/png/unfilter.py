"""Undoes the filters of a PNG's rows.

Source: PNG specification, third edition (W3C), section 9.
"""

import numpy as np

from hsslam_node.kernels.compiled import njit

_NONE, _SUB, _UP, _AVERAGE, _PAETH = range(5)


@njit(cache=True, nogil=True, error_model="numpy")
def unfilter(rows, step, out):
    """Write the bytes of pixels; False: a row has an unknown filter.

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
        elif kind == _UP:
            for i in range(width):
                here[i] = row[i] + above[i]
        elif kind == _AVERAGE:
            for i in range(step):
                here[i] = row[i] + (above[i] >> 1)
            for i in range(step, width):
                here[i] = row[i] + ((np.int32(here[i - step]) + np.int32(above[i])) >> 1)
        elif kind in (_SUB, _PAETH):
            pixels = (width // step, step)
            row, above, here = row.reshape(pixels), above.reshape(pixels), here.reshape(pixels)
            if kind == _SUB and step == 3:
                _unfilter_sub_of_three(row, here)
            elif kind == _SUB:
                _unfilter_sub_of_two(row, here)
            elif step == 3:
                _unfilter_paeth_of_three(row, above, here)
            else:
                _unfilter_paeth_of_two(row, above, here)
        else:
            return False
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _unfilter_sub_of_three(row, here):
    """Pixels of three bytes [W, 3]; sums stay in registers, as memory is slower than an addition."""
    sum_0 = sum_1 = sum_2 = np.uint8(0)
    for p in range(len(here)):
        sum_0, sum_1, sum_2 = sum_0 + row[p, 0], sum_1 + row[p, 1], sum_2 + row[p, 2]
        here[p, 0], here[p, 1], here[p, 2] = sum_0, sum_1, sum_2


@njit(cache=True, nogil=True, error_model="numpy")
def _unfilter_sub_of_two(row, here):
    """The same for pixels of two bytes [W, 2]."""
    sum_0 = sum_1 = np.uint8(0)
    for p in range(len(here)):
        sum_0, sum_1 = sum_0 + row[p, 0], sum_1 + row[p, 1]
        here[p, 0], here[p, 1] = sum_0, sum_1


@njit(cache=True, nogil=True, error_model="numpy")
def _unfilter_paeth_of_three(row, above, here):
    """Pixels of three bytes [W, 3]: all bytes at once, as each pixel waits for the one to its left."""
    left_0 = left_1 = left_2 = corner_0 = corner_1 = corner_2 = 0
    for p in range(len(here)):
        up_0, up_1, up_2 = np.int64(above[p, 0]), np.int64(above[p, 1]), np.int64(above[p, 2])
        left_0 = _plus_paeth(row[p, 0], left_0, up_0, corner_0)
        left_1 = _plus_paeth(row[p, 1], left_1, up_1, corner_1)
        left_2 = _plus_paeth(row[p, 2], left_2, up_2, corner_2)
        corner_0, corner_1, corner_2 = up_0, up_1, up_2
        here[p, 0], here[p, 1], here[p, 2] = left_0, left_1, left_2


@njit(cache=True, nogil=True, error_model="numpy")
def _unfilter_paeth_of_two(row, above, here):
    """The same for pixels of two bytes [W, 2]."""
    left_0 = left_1 = corner_0 = corner_1 = 0
    for p in range(len(here)):
        up_0, up_1 = np.int64(above[p, 0]), np.int64(above[p, 1])
        left_0 = _plus_paeth(row[p, 0], left_0, up_0, corner_0)
        left_1 = _plus_paeth(row[p, 1], left_1, up_1, corner_1)
        corner_0, corner_1 = up_0, up_1
        here[p, 0], here[p, 1] = left_0, left_1


@njit(cache=True, nogil=True, error_model="numpy")
def _plus_paeth(byte, left, up, corner):
    """A byte plus its Paeth predictor (left, up or the corner between them), modulo 256."""
    from_left, from_up = abs(up - corner), abs(left - corner)
    from_both = abs(left + up - 2 * corner)
    best = up if from_up < from_left else left
    best = corner if from_both < min(from_left, from_up) else best
    return (np.int64(byte) + best) & 255
