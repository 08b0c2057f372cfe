"""The values of a grid moved by whole voxels, in place; apart from `Occupancy`, as this is compiled."""

import numpy as np

from hsslam_node.kernels.compiled import njit
from hsslam_node.kernels.copy_rows import copy_row


@njit(cache=True, nogil=True, error_model="numpy")
def shift(values, steps):
    """Move values [nz, ny, nx] by `steps` [3] (z, y, x) towards the start of their axes; zeros follow."""
    nz, ny, nx = values.shape
    begin, end = max(-steps[2], 0), nx - max(steps[2], 0)  # of what is kept of a row
    line = np.zeros(nx, values.dtype)
    for n in range(nz):
        k = n if steps[0] >= 0 else nz - 1 - n
        for m in range(ny):
            j = m if steps[1] >= 0 else ny - 1 - m
            c, b = k + steps[0], j + steps[1]
            if 0 <= c < nz and 0 <= b < ny and begin < end:
                copy_row(values[c, b, begin + steps[2] : end + steps[2]], line[begin:end])
                copy_row(line, values[k, j])
            else:
                values[k, j] = 0
