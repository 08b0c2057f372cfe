"""Arrays that start at a cache line, so that no vector of 16 floats lies across two lines."""

import math

import numpy as np
from numba import njit

LINE_BYTES = 64


def aligned_zeros(*shape: int) -> np.ndarray:
    """float32 zeros of this shape, C-contiguous, the first at a multiple of 64 bytes."""
    size = math.prod(shape)
    raw = np.zeros(4 * size + LINE_BYTES, np.uint8)
    start = -raw.ctypes.data % LINE_BYTES
    return raw[start : start + 4 * size].view(np.float32).reshape(shape)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def aligned_rows(rows, columns):
    """The same inside a kernel, [rows, columns], not set to anything."""
    raw = np.empty(rows * columns + 16, np.float32)
    start = (-raw.ctypes.data >> 2) & 15
    return raw[start : start + rows * columns].reshape(rows, columns)
