"""A gradient over all parameters that remembers where it was written, in two levels of marks."""

from typing import NamedTuple

import numpy as np
from numba import njit

from hsslam_node.kernels.aligned import aligned_zeros
from hsslam_node.kernels.kernel_layout import KernelLayout

PAGE = 64  # chunks of 16 floats, a page of marks being one cache line


class Gradient(NamedTuple):
    """Gradient whose cost to step does not depend on the size of the map: only what is marked is read."""

    values: np.ndarray  # [P] float32, zero outside the touched chunks
    touched: np.ndarray  # [pages * PAGE] uint8, one a chunk of 16 floats
    pages: np.ndarray  # [ceil(P / 16 / PAGE)] uint8, not 0 where the page has a touched chunk


def gradient(layout: KernelLayout) -> Gradient:
    """An empty gradient for all parameters."""
    P = layout.parameter_count
    pages = -(-P // (16 * PAGE))
    marks = np.zeros(pages * PAGE, np.uint8)
    return Gradient(aligned_zeros(P), marks, np.zeros(pages, np.uint8))


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def touch_rows(grad, first, row, C):
    """Mark the four corners of a plane's cell: 2 C floats from `first` and from `first + row` on."""
    for start in (first, first + row):
        for chunk in range(start >> 4, (start + 2 * C) >> 4):
            grad.touched[chunk] = 1
        grad.pages[start >> 10] = 1
        grad.pages[(start + 2 * C - 1) >> 10] = 1


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def touch_range(grad, first, last):
    """Mark all chunks of floats first to last - 1."""
    grad.touched[first >> 4 : ((last - 1) >> 4) + 1] = 1
    grad.pages[first >> 10 : ((last - 1) >> 10) + 1] = 1
