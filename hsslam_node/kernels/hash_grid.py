"""Multi-resolution hash grid on the CPU: trilinear gather, its scatter, its derivative by position.

All take a block of positions [n, 3] (m, from vertex (0, 0, 0)) and the first 2 L columns of a
feature matrix [n, W]. Levels are the outer loop, so one table at a time is in the cache. Cells and
corner offsets of a level are computed for the whole block at once; then the eight corners of a point
(two features each) are one vector of 16 lanes: x alternates with every pair, y with every second, z in
the halves.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from hsslam_node.kernels.simd import (
    add_pairs,
    fma,
    load,
    load_pairs,
    mul,
    spread,
    spread_pair,
    store_pair_total,
    total,
)

PRIME_Y = 2654435761
PRIME_Z = 805459861
_BLOCK = 256  # points whose cells are computed at once
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
        for start in range(0, n, _BLOCK):
            m = min(n - start, _BLOCK)
            _find_cells(layout, level, axes, start, m, cells)
            for k in range(m):
                x, y, z = _corner_weights(cells, k)
                value = load_pairs(table, cells.offset, k, _BLOCK)
                store_pair_total(out, 2 * (start + k), mul(value, mul(x, mul(y, z))))


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def scatter_hash(grad, layout, axes, n, d_features):
    """Add the gradient of `gather_hash` to `grad` (a `Gradient`) and mark where it lies.

    Successive points in one cell, as samples of a ray often are, are added up first.
    """
    cells = _cells()
    first_hashed = layout.geometry_W1
    for level in range(layout.hash_offset.shape[0] - 1, -1, -1):
        if layout.hash_mask[level] != 0:
            first_hashed = layout.hash_offset[level]
    for level in range(layout.hash_offset.shape[0]):
        dense = layout.hash_mask[level] == 0
        table = grad.values[layout.hash_offset[level] :]
        marks = grad.touched[layout.hash_offset[level] >> 4 :]
        d_out = d_features[level]
        for start in range(0, n, _BLOCK):
            m = min(n - start, _BLOCK)
            _find_cells(layout, level, axes, start, m, cells)
            k = 0
            while k < m:
                first = k
                d = spread(np.float32(0.0))
                while k < m and _same_cell(cells, first, k):
                    x, y, z = _corner_weights(cells, k)
                    d = fma(spread_pair(d_out, 2 * (start + k)), mul(x, mul(y, z)), d)
                    k += 1
                add_pairs(table, cells.offset, first, _BLOCK, d)
                for c in range(8):
                    marks[cells.offset[c * _BLOCK + first] >> 4] = 1
                    if dense:
                        at = layout.hash_offset[level] + cells.offset[c * _BLOCK + first]
                        grad.pages[at >> 10] = 1
    # hashed levels do not grow with the map: all their pages
    grad.pages[first_hashed >> 10 : ((layout.geometry_W1 - 1) >> 10) + 1] = 1


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def hash_position_gradient(params, layout, axes, n, d_features, d_position):
    """Add d(loss)/d(position) to d_position [N, 3] (1/m)."""
    cells = _cells()
    for level in range(layout.hash_offset.shape[0]):
        table = params[layout.hash_offset[level] :]
        scale = layout.hash_scale[level]
        d_out = d_features[level]
        for start in range(0, n, _BLOCK):
            m = min(n - start, _BLOCK)
            _find_cells(layout, level, axes, start, m, cells)
            for k in range(m):
                x, y, z = _corner_weights(cells, k)
                value = load_pairs(table, cells.offset, k, _BLOCK)
                d = mul(value, spread_pair(d_out, 2 * (start + k)))
                d_position[start + k, 0] += scale * total(mul(mul(d, load(_SIGN, 0)), mul(y, z)))
                d_position[start + k, 1] += scale * total(mul(mul(d, load(_SIGN, 16)), mul(x, z)))
                d_position[start + k, 2] += scale * total(mul(mul(d, load(_SIGN, 32)), mul(x, y)))


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _cells():
    return _Cells(
        np.empty(3 * _BLOCK, np.int32),
        np.empty(3 * _BLOCK, np.float32),
        np.empty(8 * _BLOCK, np.int32),
    )


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _find_cells(layout, level, axes, start, m, cells):
    """Fill `cells` for points start to start + m - 1."""
    scale = layout.hash_scale[level]
    for axis in range(3):
        p = axes[axis, start : start + m]
        corner = cells.corner[axis * _BLOCK : axis * _BLOCK + m]
        fraction = cells.fraction[axis * _BLOCK : axis * _BLOCK + m]
        lowest = np.float32(layout.hash_first[level, axis])
        last = np.int32(layout.hash_first[level, axis] + layout.hash_count[level, axis] - 2)
        for k in range(m):
            g = max(p[k] * scale, lowest)
            i = np.int32(min(np.int32(np.floor(g)), last))
            corner[k] = i
            fraction[k] = g - np.float32(i)
    mask = layout.hash_mask[level]
    x = cells.corner[:m]
    y = cells.corner[_BLOCK : _BLOCK + m]
    z = cells.corner[2 * _BLOCK : 2 * _BLOCK + m]
    for c in range(8):
        dx, dy, dz = c & 1, c >> 1 & 1, c >> 2
        out = cells.offset[c * _BLOCK : c * _BLOCK + m]
        if mask == 0:  # dense, x fastest
            n_x, n_y = layout.hash_count[level, 0], layout.hash_count[level, 1]
            first = layout.hash_first[level]
            far = 2 * (dx - first[0] + n_x * (dy - first[1] + n_y * (dz - first[2])))
            for k in range(m):
                out[k] = np.int32(2 * (x[k] + n_x * (y[k] + n_y * z[k])) + far)
        else:  # XOR hash (Instant-NGP, eq. 4)
            for k in range(m):
                mixed = (x[k] + dx) ^ ((y[k] + dy) * PRIME_Y) ^ ((z[k] + dz) * PRIME_Z)
                out[k] = np.int32(2 * (mixed & mask))


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _same_cell(cells, a, b):
    corner = cells.corner
    return (
        corner[a] == corner[b]
        and corner[_BLOCK + a] == corner[_BLOCK + b]
        and corner[2 * _BLOCK + a] == corner[2 * _BLOCK + b]
    )


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _corner_weights(cells, k):
    """Weight of the eight corners along x, y, z; their product is that of the corner."""
    fraction = cells.fraction
    return (
        fma(spread(fraction[k]), load(_SIGN, 0), load(_LOWER, 0)),
        fma(spread(fraction[_BLOCK + k]), load(_SIGN, 16), load(_LOWER, 16)),
        fma(spread(fraction[2 * _BLOCK + k]), load(_SIGN, 32), load(_LOWER, 32)),
    )
