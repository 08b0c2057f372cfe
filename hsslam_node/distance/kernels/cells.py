"""Layers of voxels to cells of the floor; apart from `GridMap`, as this is compiled."""

import numpy as np

from hsslam_node.distance.states import FREE, OCCUPIED
from hsslam_node.kernels.compiled import njit

_FREE, _OCCUPIED = np.uint8(FREE), np.uint8(OCCUPIED)


@njit(cache=True, nogil=True, error_model="numpy")
def look_down(states, free, occupied):
    """Add up what lies over each cell.

    Args:
        states: [layers, ny, nx] uint8.
        free: [ny, nx] int32, 0; the number of free voxels is written.
        occupied: [ny, nx] uint8, 0; 1 is written where a voxel is occupied.
    """
    layers, ny, nx = states.shape
    for k in range(layers):
        for j in range(ny):
            row, count, has_occupied = states[k, j], free[j], occupied[j]
            for i in range(nx):
                count[i] += np.int32(row[i] == _FREE)
                has_occupied[i] |= np.uint8(row[i] == _OCCUPIED)
