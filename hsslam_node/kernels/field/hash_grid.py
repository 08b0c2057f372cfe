"""Multi-resolution hash grid on the CPU: trilinear gather, its scatter, its derivative by position.

Twin: `gpu_kernels/field/hash_grid.py`. Reference: `reference/hash_grid.py`.

All functions take n positions as axes [3, N] (m, from vertex (0, 0, 0)) and features [L, N, 2]. Levels
are the outer loop, so one table at a time is in the cache. They compute cells and corner offsets of a
level for blocks of 256 points; then the eight corners of a point (two features each) are one vector of 16
lanes: x alternates with every pair, y with every second, z in the halves.
"""

from typing import NamedTuple

import numpy as np

from hsslam_node.kernels.compiled import njit
from hsslam_node.kernels.field.layout import BLOCK
from hsslam_node.kernels.simd import fma, load, mul, spread, total
from hsslam_node.kernels.simd_pairs import add_pairs, load_pairs, spread_pair, store_pair_total

PRIME_Y = 2654435761
PRIME_Z = 805459861
_UPPER = np.array(  # [3 * 16] 1 in the lanes of the upper corners along x, y, z
    [[lane >> (1 + axis) & 1 for lane in range(16)] for axis in range(3)], np.float32
).ravel()
_LOWER = 1 - _UPPER
_SIGN = _UPPER - _LOWER


class _Cells(NamedTuple):
    """Work space: cells of a block of n points in one level."""

    corner: np.ndarray  # [3 * n] int32, lower vertex x, y, z
    fraction: np.ndarray  # [3 * n]
    offset: np.ndarray  # [8 * n] int32, floats from the start of the level, corner by corner


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def gather_hash(params, layout, axes, n, features):
    """Features of all levels at points[:n]; axes [3, N] m, features [L, N, 2]."""
    cells = _cells()
    for level in range(layout.hash_offset.shape[0]):
        table = params[layout.hash_offset[level] :]
        out = features[level]
        for start in range(0, n, BLOCK):
            m = min(n - start, BLOCK)
            _find_cells(layout, level, axes, start, m, cells)
            for k in range(m):
                x, y, z = _corner_weights(cells, k)
                value = load_pairs(table, cells.offset, k, BLOCK)
                store_pair_total(out, 2 * (start + k), mul(value, mul(x, mul(y, z))))


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def scatter_hash(grad, layout, axes, n, d_features):
    """Add the gradient of `gather_hash` to `grad` (a `Gradient`), which needs no marks here.

    Successive points in one cell, as samples of a ray often are, are added up first.
    """
    cells = _cells()
    for level in range(layout.hash_offset.shape[0]):
        table = grad.values[layout.hash_offset[level] :]
        d_out = d_features[level]
        for start in range(0, n, BLOCK):
            m = min(n - start, BLOCK)
            _find_cells(layout, level, axes, start, m, cells)
            k = 0
            while k < m:
                first = k
                d = spread(np.float32(0.0))
                while k < m and _same_cell(cells, first, k):
                    x, y, z = _corner_weights(cells, k)
                    d = fma(spread_pair(d_out, 2 * (start + k)), mul(x, mul(y, z)), d)
                    k += 1
                add_pairs(table, cells.offset, first, BLOCK, d)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def hash_position_gradient(params, layout, axes, n, d_features, d_position):
    """Add d(loss)/d(position) to d_position [N, 3] (1/m)."""
    cells = _cells()
    for level in range(layout.hash_offset.shape[0]):
        table = params[layout.hash_offset[level] :]
        scale = layout.hash_scale[level]
        d_out = d_features[level]
        for start in range(0, n, BLOCK):
            m = min(n - start, BLOCK)
            _find_cells(layout, level, axes, start, m, cells)
            for k in range(m):
                x, y, z = _corner_weights(cells, k)
                value = load_pairs(table, cells.offset, k, BLOCK)
                d = mul(value, spread_pair(d_out, 2 * (start + k)))
                d_position[start + k, 0] += scale * total(mul(mul(d, load(_SIGN, 0)), mul(y, z)))
                d_position[start + k, 1] += scale * total(mul(mul(d, load(_SIGN, 16)), mul(x, z)))
                d_position[start + k, 2] += scale * total(mul(mul(d, load(_SIGN, 32)), mul(x, y)))


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _cells():
    return _Cells(
        np.empty(3 * BLOCK, np.int32),
        np.empty(3 * BLOCK, np.float32),
        np.empty(8 * BLOCK, np.int32),
    )


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _find_cells(layout, level, axes, start, m, cells):
    """Fill `cells` for points start to start + m - 1."""
    scale = layout.hash_scale[level]
    for axis in range(3):
        p = axes[axis, start : start + m]
        corner = cells.corner[axis * BLOCK : axis * BLOCK + m]
        fraction = cells.fraction[axis * BLOCK : axis * BLOCK + m]
        lowest = np.float32(layout.hash_first[level, axis])
        last = np.int32(layout.hash_first[level, axis] + layout.hash_count[level, axis] - 2)
        for k in range(m):
            g = max(p[k] * scale, lowest)
            i = np.int32(min(np.int32(np.floor(g)), last))
            corner[k] = i
            fraction[k] = g - np.float32(i)
    x = cells.corner[:m]
    y = cells.corner[BLOCK : BLOCK + m]
    z = cells.corner[2 * BLOCK : 2 * BLOCK + m]
    mask = np.int32(2 * layout.hash_mask[level])
    n_x, n_y = np.int32(layout.hash_count[level, 0]), np.int32(layout.hash_count[level, 1])
    first = layout.hash_first[level]
    for upper in range(4):  # corners in pairs along x; all in 32 bits, which vectorises well
        dy, dz = np.int32(upper & 1), np.int32(upper >> 1)
        low = cells.offset[2 * upper * BLOCK : 2 * upper * BLOCK + m]
        high = cells.offset[(2 * upper + 1) * BLOCK : (2 * upper + 1) * BLOCK + m]
        if mask == 0:  # dense, x fastest
            far = np.int32(2 * (n_x * (dy - first[1] + n_y * (dz - first[2])) - first[0]))
            for k in range(m):
                row = np.int32(y[k] + np.int32(n_y * z[k]))
                offset = np.int32(2 * np.int32(x[k] + np.int32(n_x * row)) + far)
                low[k] = offset
                high[k] = offset + np.int32(2)
        else:  # XOR hash (Instant-NGP, eq. 4)
            for k in range(m):
                from_y, from_z = np.int32((y[k] + dy) * PRIME_Y), np.int32((z[k] + dz) * PRIME_Z)
                mixed = np.int32(from_y ^ from_z)
                low[k] = np.int32((x[k] ^ mixed) << 1) & mask
                high[k] = np.int32(((x[k] + np.int32(1)) ^ mixed) << 1) & mask


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _same_cell(cells, a, b):
    corner = cells.corner
    return (
        corner[a] == corner[b]
        and corner[BLOCK + a] == corner[BLOCK + b]
        and corner[2 * BLOCK + a] == corner[2 * BLOCK + b]
    )


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _corner_weights(cells, k):
    """Weight of the eight corners along x, y, z; their product is that of the corner."""
    fraction = cells.fraction
    return (
        fma(spread(fraction[k]), load(_SIGN, 0), load(_LOWER, 0)),
        fma(spread(fraction[BLOCK + k]), load(_SIGN, 16), load(_LOWER, 16)),
        fma(spread(fraction[2 * BLOCK + k]), load(_SIGN, 32), load(_LOWER, 32)),
    )
