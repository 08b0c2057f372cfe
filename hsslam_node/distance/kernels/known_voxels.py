"""From evidence to what is known of each voxel, and where the known ones lie."""

import math

import numpy as np

from hsslam_node.distance.kernels.hits import OCCUPIED_FROM
from hsslam_node.distance.states import FREE, OCCUPIED, UNKNOWN
from hsslam_node.kernels.compiled import njit
from hsslam_node.kernels.simd import WIDTH

_OCCUPIED_FROM, _NOTHING = np.int8(OCCUPIED_FROM), np.int8(0)
_FREE, _OCCUPIED, _UNKNOWN = np.uint8(FREE), np.uint8(OCCUPIED), np.uint8(UNKNOWN)


def room_for_states(shape: tuple[int, ...]) -> np.ndarray:
    """uint8 [nz, ny, nx], in memory that a vector may read beyond the end."""
    size = math.prod(shape)
    return np.empty(size + WIDTH, np.uint8)[:size].reshape(shape)


@njit(cache=True, nogil=True, error_model="numpy")
def write_states(evidence, states, box):
    """Write the states [nz, ny, nx] of evidence, and the box of the known ones; see `known_box`."""
    for k in range(len(states)):
        here, out = evidence[k].reshape(-1), states[k].reshape(-1)
        for n in range(len(out)):
            e = here[n]
            out[n] = _OCCUPIED if e >= _OCCUPIED_FROM else _FREE if e < _NOTHING else _UNKNOWN
    return known_box(states, box)


@njit(cache=True, nogil=True, error_model="numpy")
def known_box(states, box):
    """Number of the occupied voxels of states [nz, ny, nx]; `box` [2, 3]: where the known ones begin and end.

    The box is one voxel wider to all sides, as far as the grid goes, and in the order z, y, x.
    """
    nz, ny, nx = states.shape
    over = np.zeros((ny, nx), np.uint8)  # all layers at once
    low_z, high_z, count = nz, 0, 0
    for k in range(nz):
        occupied, seen = _look(states[k].reshape(-1), over.reshape(-1))
        count += occupied
        if seen:
            low_z, high_z = min(low_z, k), k + 1
    low_y, low_x, high_y, high_x = ny, nx, 0, 0
    for j in range(ny):
        for i in range(nx):
            if over[j, i]:
                low_y, high_y = min(low_y, j), j + 1
                low_x, high_x = min(low_x, i), max(high_x, i + 1)
    box[0, 0], box[1, 0] = max(low_z - 1, 0), min(high_z + 1, nz)
    box[0, 1], box[1, 1] = max(low_y - 1, 0), min(high_y + 1, ny)
    box[0, 2], box[1, 2] = max(low_x - 1, 0), min(high_x + 1, nx)
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def _look(states, over):
    """Number of the occupied voxels of a layer, and whether one is known; `over` gets the known ones."""
    count, seen = np.int32(0), np.uint8(0)
    for n in range(len(states)):
        state = states[n]
        # in 8 and 32 bits, as many at once as a vector has room for
        count = np.int32(count + np.int32(state == _OCCUPIED))
        seen = np.uint8(seen | state)
        over[n] |= state
    return count, seen != 0
