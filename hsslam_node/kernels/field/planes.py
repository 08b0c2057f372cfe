"""Tri-plane look-ups on the CPU: bilinear gather, its scatter, and its derivative by position.

Twin: `gpu_kernels/field/planes.py`. Reference: `reference/encodings.py`.

All functions take n <= 256 positions of axes [3, N] (m, from vertex (0, 0, 0)) from `start` on and C columns
of a feature matrix [n, W] from column `first` on. They first compute the cells of all points. Then channels
are innermost and a multiple of 16, so each corner is one or two vectors, and registers sum the three planes
of a set.
"""

from typing import NamedTuple

import numpy as np

from hsslam_node.kernels.compiled import njit
from hsslam_node.kernels.field.gradient import touch_rows
from hsslam_node.kernels.field.layout import BLOCK
from hsslam_node.kernels.simd import add, fma, load, spread, store, sub, total

_U, _V = (0, 0, 1), (1, 2, 2)  # axes of the xy, xz and yz planes


class _Cells(NamedTuple):
    """Work space: where a block of points lies in the planes of a set."""

    vertex: np.ndarray  # [3 * 256] int32, lower vertex along x, y, z
    fraction: np.ndarray  # [3 * 256]
    corner: np.ndarray  # [3 * 256] int64, lower corner in each plane, floats from params' start


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def gather_planes(params, layout, plane_set, axes, start, features, first):
    """Sum of the three planes' features."""
    C, (n, stride) = layout.channels, features.shape
    cells = _find_cells(layout, plane_set, axes, start, n)
    row_x, row_y = _rows(layout, plane_set)
    for k in range(n):
        fx, fy, fz, xy, xz, yz = _at(cells, k)
        for c in range(0, C, 16):
            out = spread(np.float32(0.0))
            out = _blend(params, xy + c, C, row_x, fx, fy, out)
            out = _blend(params, xz + c, C, row_x, fx, fz, out)
            out = _blend(params, yz + c, C, row_y, fy, fz, out)
            store(features, k * stride + first + c, out)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def scatter_planes(grad, layout, plane_set, axes, start, d_features, first):
    """Add the gradient of `gather_planes` to `grad` (a `Gradient`) and mark its chunks.

    Successive points in one cell, as samples of a ray often are, are added up first.
    """
    cells = _find_cells(layout, plane_set, axes, start, d_features.shape[0])
    row_x, row_y = _rows(layout, plane_set)
    fx, fy = cells.fraction[:BLOCK], cells.fraction[BLOCK : 2 * BLOCK]
    fz = cells.fraction[2 * BLOCK :]
    corner, C = cells.corner, layout.channels
    _scatter_plane(grad, row_x, C, corner, fx, fy, d_features, first)
    _scatter_plane(grad, row_x, C, corner[BLOCK:], fx, fz, d_features, first)
    _scatter_plane(grad, row_y, C, corner[2 * BLOCK :], fy, fz, d_features, first)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _scatter_plane(grad, row, C, corner, fraction_u, fraction_v, d_features, first):
    n, stride = d_features.shape
    zero = spread(np.float32(0.0))
    for c in range(first, first + C, 16):
        k = 0
        while k < n:
            at = corner[k]
            s = s_u = s_v = s_uv = zero  # sums of d, fu d, fv d, fu fv d over the cell
            while k < n and corner[k] == at:
                fu, fv = fraction_u[k], fraction_v[k]
                d = load(d_features, k * stride + c)
                s = add(d, s)
                s_u = fma(spread(fu), d, s_u)
                s_v = fma(spread(fv), d, s_v)
                s_uv = fma(spread(fu * fv), d, s_uv)
                k += 1
            o = at + c - first
            u, v = sub(s_u, s_uv), sub(s_v, s_uv)
            store(grad.values, o, add(load(grad.values, o), sub(sub(s, s_u), v)))
            store(grad.values, o + C, add(load(grad.values, o + C), u))
            store(grad.values, o + row, add(load(grad.values, o + row), v))
            store(grad.values, o + row + C, add(load(grad.values, o + row + C), s_uv))
            if c == first:
                touch_rows(grad, at, row, C)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def plane_position_gradient(params, layout, plane_set, axes, start, d_features, first, d_position):
    """Add d(loss)/d(position) to d_position [n, 3] (1/m)."""
    C, (n, stride) = layout.channels, d_features.shape
    inv_cell = layout.plane_inv_cell[plane_set]
    cells = _find_cells(layout, plane_set, axes, start, n)
    row_x, row_y = _rows(layout, plane_set)
    for k in range(n):
        fx, fy, fz, xy, xz, yz = _at(cells, k)
        d_x = d_y = d_z = spread(np.float32(0.0))
        for c in range(0, C, 16):
            d = load(d_features, k * stride + first + c)
            u, v = _slopes(params, xy + c, C, row_x, fx, fy)
            d_x = fma(d, u, d_x)
            d_y = fma(d, v, d_y)
            u, v = _slopes(params, xz + c, C, row_x, fx, fz)
            d_x = fma(d, u, d_x)
            d_z = fma(d, v, d_z)
            u, v = _slopes(params, yz + c, C, row_y, fy, fz)
            d_y = fma(d, u, d_y)
            d_z = fma(d, v, d_z)
        d_position[k, 0] += inv_cell * total(d_x)
        d_position[k, 1] += inv_cell * total(d_y)
        d_position[k, 2] += inv_cell * total(d_z)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _find_cells(layout, plane_set, axes, start, n):
    """The cells of n points, clamped to the border."""
    cells = _Cells(
        np.empty(3 * BLOCK, np.int32),
        np.empty(3 * BLOCK, np.float32),
        np.empty(3 * BLOCK, np.int64),
    )
    inv_cell = layout.plane_inv_cell[plane_set]
    for a in range(3):
        p = axes[a, start : start + n]
        vertex = cells.vertex[a * BLOCK : a * BLOCK + n]
        fraction = cells.fraction[a * BLOCK : a * BLOCK + n]
        first, count = layout.plane_first[plane_set, a], layout.plane_count[plane_set, a]
        low, high = np.float32(first), np.float32(first + count - 1)
        last = np.int32(first + count - 2)
        for k in range(n):
            g = min(max(p[k] * inv_cell, low), high)
            i = np.int32(min(np.int32(np.floor(g)), last))
            vertex[k] = i
            fraction[k] = g - np.float32(i)
    C = np.int32(layout.channels)
    for plane in range(3):
        offset = layout.plane_offset[plane_set, plane]
        row = np.int32(layout.plane_count[plane_set, _U[plane]])
        u = cells.vertex[_U[plane] * BLOCK : _U[plane] * BLOCK + n]
        v = cells.vertex[_V[plane] * BLOCK : _V[plane] * BLOCK + n]
        corner = cells.corner[plane * BLOCK : plane * BLOCK + n]
        for k in range(n):
            corner[k] = offset + np.int32((v[k] * row + u[k]) * C)
    return cells


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _at(cells, k):
    """Fractions along x, y, z of a point, and its lower corners in the xy, xz and yz planes."""
    fraction, corner = cells.fraction, cells.corner
    return (
        fraction[k],
        fraction[BLOCK + k],
        fraction[2 * BLOCK + k],
        corner[k],
        corner[BLOCK + k],
        corner[2 * BLOCK + k],
    )


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _rows(layout, s):
    """Floats to the next row of the xy and xz planes of a set, and of its yz plane."""
    return layout.plane_count[s, 0] * layout.channels, layout.plane_count[s, 1] * layout.channels


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _blend(params, o, C, row, fu, fv, out):
    """out + the bilinear value of 16 channels; `o` the lower corner, `row` floats to the next row."""
    w11 = fu * fv
    out = fma(spread(np.float32(1.0) - fu - fv + w11), load(params, o), out)
    out = fma(spread(fu - w11), load(params, o + C), out)
    out = fma(spread(fv - w11), load(params, o + row), out)
    return fma(spread(w11), load(params, o + row + C), out)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _slopes(params, o, C, row, fu, fv):
    """Derivative of `_blend` by fu and by fv."""
    v00, v01 = load(params, o), load(params, o + C)
    v10, v11 = load(params, o + row), load(params, o + row + C)
    along_u, across = sub(v01, v00), sub(v10, v00)
    twist = sub(sub(v11, v10), along_u)
    return fma(spread(fv), twist, along_u), fma(spread(fu), twist, across)
