"""Distances of a grid in blocks, in whole mm, and which blocks are others than before."""

import numpy as np

from hsslam_node.distance.states import BLOCK_SIDE, NOT_KNOWN_MM
from hsslam_node.kernels.compiled import njit

_NOT_KNOWN = np.int16(NOT_KNOWN_MM)
_LEAST_MM, _LARGEST_MM = np.float32(-32767.0), np.float32(32767.0)


@njit(cache=True, nogil=True, error_model="numpy")
def renew_blocks(distance_m, offset, box, tolerance_mm, blocks, changed):
    """Write distances into the blocks in which one has changed by more than `tolerance_mm`.

    Args:
        distance_m: [nz, ny, nx] float32 m, nan: not known.
        offset: [3] int64, place (z, y, x) of voxel (0, 0, 0) in block (0, 0, 0).
        box: [2, 3] int64 (z, y, x), first and end of the blocks that know something, before or now.
        tolerance_mm: int.
        blocks: [Z * BLOCK_SIDE, Y * BLOCK_SIDE, X * BLOCK_SIDE] int16 mm; renewed in place.
        changed: [Z, Y, X] uint8, 0; 1 is written for those that are renewed.
    """
    nz, ny, nx = distance_m.shape
    low, high = box[0, 2] * BLOCK_SIDE, box[1, 2] * BLOCK_SIDE  # of rows, as are left and right
    left, right = max(low, offset[2]), min(high, offset[2] + nx)
    rows = np.full((BLOCK_SIDE * BLOCK_SIDE, high - low), _NOT_KNOWN, np.int16)
    most = np.empty(high - low, np.uint16)
    for c in range(box[0, 0], box[1, 0]):
        for b in range(box[0, 1], box[1, 1]):
            most[:] = 0
            for n in range(BLOCK_SIDE * BLOCK_SIDE):
                z, y = c * BLOCK_SIDE + n // BLOCK_SIDE, b * BLOCK_SIDE + n % BLOCK_SIDE
                k, j = z - offset[0], y - offset[1]
                row = rows[n]
                if 0 <= k < nz and 0 <= j < ny and left < right:
                    values_m = distance_m[k, j, left - offset[2] : right - offset[2]]
                    _to_mm(values_m, row[left - low : right - low])
                else:
                    row[:] = _NOT_KNOWN
                _compare(row, blocks[z, y, low:high], most)
            for a in range(box[0, 2], box[1, 2]):
                at = a * BLOCK_SIDE - low
                if most[at : at + BLOCK_SIDE].max() > tolerance_mm:
                    changed[c, b, a] = 1
                    _copy_rows(rows, at, _block(blocks, c, b, a))


@njit(cache=True, nogil=True, error_model="numpy")
def take_blocks(blocks, places, out):
    """Copy the blocks at places [B, 3] (z, y, x) to `out` [B, BLOCK_SIDE, BLOCK_SIDE, BLOCK_SIDE]."""
    for n in range(len(places)):
        _copy(_block(blocks, places[n, 0], places[n, 1], places[n, 2]), out[n])


@njit(cache=True, nogil=True, error_model="numpy")
def _block(blocks, c, b, a):
    """A view of one, [BLOCK_SIDE, BLOCK_SIDE, BLOCK_SIDE]."""
    side = BLOCK_SIDE
    z, y, x = c * side, b * side, a * side
    return blocks[z : z + side, y : y + side, x : x + side]


@njit(cache=True, nogil=True, error_model="numpy")
def _copy(source, target):
    """A block, row by row."""
    for k in range(BLOCK_SIDE):
        for j in range(BLOCK_SIDE):
            a, b = source[k, j], target[k, j]
            for i in range(BLOCK_SIDE):
                b[i] = a[i]


@njit(cache=True, nogil=True, error_model="numpy")
def _copy_rows(rows, at, target):
    """A block, from its place in 256 longer rows."""
    for n in range(BLOCK_SIDE * BLOCK_SIDE):
        a, b = rows[n], target[n // BLOCK_SIDE, n % BLOCK_SIDE]
        for i in range(BLOCK_SIDE):
            b[i] = a[at + i]


@njit(cache=True, nogil=True, error_model="numpy")
def _to_mm(values_m, out):
    """Write distances [n] in mm."""
    for i in range(len(out)):
        mm = min(np.float32(1000.0) * values_m[i], _LARGEST_MM)
        mm = mm if mm >= _LEAST_MM else np.float32(NOT_KNOWN_MM)  # of nan too
        out[i] = np.int32(np.rint(mm))


@njit(cache=True, nogil=True, error_model="numpy")
def _compare(now, before, most):
    """Let `most` [n] uint16 grow to the differences of two rows [n] int16."""
    for i in range(len(most)):
        a, b = now[i], before[i]
        apart = np.uint16(a - b if a > b else b - a)
        most[i] = apart if apart > most[i] else most[i]
