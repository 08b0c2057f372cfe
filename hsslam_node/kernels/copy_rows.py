"""Rows copied by loops; apart because kernels of the field, of distances and of the built-in scenes use it.

For each assignment of an array to a slice of another, numba compiles a message that names both shapes.
Without these messages, all kernels compile in 0.84 of the core time.
"""

from hsslam_node.kernels.compiled import njit


@njit(cache=True, nogil=True, error_model="numpy")
def copy_row(source, target):
    """Copy values [n] to `target` [n]."""
    for i in range(len(target)):
        target[i] = source[i]


@njit(cache=True, nogil=True, error_model="numpy")
def copy_rows(source, target):
    """Copy values [m, n] to `target` [m, n]."""
    rows, columns = target.shape
    for k in range(rows):
        for i in range(columns):
            target[k, i] = source[k, i]
