"""Copies of scattered 16-float chunks on the host; alone, as they are compiled code."""

import numpy as np

from hsslam_node.kernels.compiled import njit

CHUNK = 16  # floats


@njit(cache=True, nogil=True)
def gather_chunks(source: np.ndarray, chunks: np.ndarray, rows: np.ndarray) -> None:
    """rows [n, 16] = the chunks [n] int64 of source [P]; all float32 but `chunks`."""
    for row in range(len(chunks)):
        first = CHUNK * chunks[row]
        for k in range(CHUNK):
            rows[row, k] = source[first + k]


@njit(cache=True, nogil=True)
def scatter_chunks(rows: np.ndarray, chunks: np.ndarray, target: np.ndarray) -> None:
    """The chunks [n] int64 of target [P] = rows [n, 16]; all float32 but `chunks`."""
    for row in range(len(chunks)):
        first = CHUNK * chunks[row]
        for k in range(CHUNK):
            target[first + k] = rows[row, k]
