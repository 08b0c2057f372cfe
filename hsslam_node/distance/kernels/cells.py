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
    count, has_occupied = free.reshape(-1), occupied.reshape(-1)
    for k in range(len(states)):
        layer = states[k].reshape(-1)
        for n in range(len(layer)):
            count[n] += np.int32(layer[n] == _FREE)
            has_occupied[n] |= np.uint8(layer[n] == _OCCUPIED)
