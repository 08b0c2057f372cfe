"""Distances of a grid in blocks, in whole mm, and which blocks are others than before."""

import numpy as np
from numba import njit

from hsslam_node.distance.states import BLOCK_SIDE, NOT_KNOWN_MM

_LEAST_MM, _LARGEST_MM = np.float32(-32767.0), np.float32(32767.0)


@njit(cache=True, nogil=True, error_model="numpy")
def renew_blocks(distance_m, offset, tolerance_mm, blocks, changed):
    """Write distances into the blocks in which one has changed by more than `tolerance_mm`.

    Args:
        distance_m: [nz, ny, nx] float32 m, nan: not known.
        offset: [3] int64, place (z, y, x) of voxel (0, 0, 0) in block (0, 0, 0).
        tolerance_mm: int.
        blocks: [Z * BLOCK_SIDE, Y * BLOCK_SIDE, X * BLOCK_SIDE] int16 mm; renewed in place.
        changed: [Z, Y, X] uint8, 0; 1 is written for those that are renewed.
    """
    nz, ny, _ = distance_m.shape
    height, width = blocks.shape[1:]
    slab = np.empty((BLOCK_SIDE, height, width), np.int16)
    for c in range(changed.shape[0]):
        slab[:] = NOT_KNOWN_MM
        first = c * BLOCK_SIDE - offset[0]
        for k in range(max(-first, 0), min(nz - first, BLOCK_SIDE)):
            for j in range(ny):
                _to_mm(distance_m[first + k, j], slab[k, offset[1] + j, offset[2] :])
        before = blocks[c * BLOCK_SIDE : (c + 1) * BLOCK_SIDE]
        _compare(slab, before, tolerance_mm, changed[c])
        for b in range(changed.shape[1]):
            rows = slice(b * BLOCK_SIDE, (b + 1) * BLOCK_SIDE)
            for a in range(changed.shape[2]):
                if changed[c, b, a]:
                    columns = slice(a * BLOCK_SIDE, (a + 1) * BLOCK_SIDE)
                    before[:, rows, columns] = slab[:, rows, columns]


@njit(cache=True, nogil=True, error_model="numpy")
def _to_mm(values_m, out):
    for i in range(len(values_m)):
        mm = np.rint(np.float32(1000.0) * values_m[i])
        mm = mm if mm < _LARGEST_MM else _LARGEST_MM
        known = np.int32(mm) if mm >= _LEAST_MM else np.int32(NOT_KNOWN_MM)
        out[i] = known if values_m[i] == values_m[i] else np.int32(NOT_KNOWN_MM)


@njit(cache=True, nogil=True, error_model="numpy")
def _compare(now, before, tolerance_mm, changed):
    """Mark the blocks of a slab [BLOCK_SIDE, Y * BLOCK_SIDE, X * BLOCK_SIDE] that differ."""
    for k in range(BLOCK_SIDE):
        for b in range(changed.shape[0]):
            for j in range(b * BLOCK_SIDE, (b + 1) * BLOCK_SIDE):
                row, old = now[k, j], before[k, j]
                for a in range(changed.shape[1]):
                    most = np.int32(0)
                    for i in range(a * BLOCK_SIDE, (a + 1) * BLOCK_SIDE):
                        most = max(most, abs(np.int32(row[i]) - np.int32(old[i])))
                    changed[b, a] |= most > tolerance_mm
