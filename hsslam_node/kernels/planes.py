"""Tri-plane look-ups on the CPU: bilinear gather, its scatter, and its derivative by position.

All take a block of positions [n, 3] (m, from vertex (0, 0, 0)) and C columns of a feature
matrix [n, W] from column `first` on. Channels are innermost and a multiple of 16, so each corner is
one or two vectors; the three planes of a set are summed in registers.
"""

import numpy as np
from numba import njit

from hsslam_node.kernels.simd import add, fma, load, spread, store, sub, total
from hsslam_node.kernels.touched import touch_rows


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def gather_planes(params, layout, plane_set, position, features, first):
    """Sum of the three planes' features."""
    C = layout.channels
    stride = features.shape[1]
    inv_cell, n_x, n_y, n_z, xy, xz, yz = _planes(layout, plane_set)
    first_x, first_y, first_z = _first_vertex(layout, plane_set)
    for k in range(position.shape[0]):
        x, fx = _corner(position[k, 0], inv_cell, first_x, n_x)
        y, fy = _corner(position[k, 1], inv_cell, first_y, n_y)
        z, fz = _corner(position[k, 2], inv_cell, first_z, n_z)
        o_xy = xy + (y * n_x + x) * C
        o_xz = xz + (z * n_x + x) * C
        o_yz = yz + (z * n_y + y) * C
        for c in range(0, C, 16):
            out = spread(np.float32(0.0))
            out = _blend(params, o_xy + c, C, n_x * C, fx, fy, out)
            out = _blend(params, o_xz + c, C, n_x * C, fx, fz, out)
            out = _blend(params, o_yz + c, C, n_y * C, fy, fz, out)
            store(features, k * stride + first + c, out)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def scatter_planes(grad, layout, plane_set, position, d_features, first):
    """Add the gradient of `gather_planes` to `grad` (a `Gradient`) and mark where it lies.

    Successive points in one cell, as samples of a ray often are, are added up first.
    """
    C, n = layout.channels, position.shape[0]
    inv_cell, n_x, n_y, n_z, xy, xz, yz = _planes(layout, plane_set)
    first_x, first_y, first_z = _first_vertex(layout, plane_set)
    cell = np.empty((3, n), np.int64)
    fraction = np.empty((3, n), np.float32)
    for k in range(n):
        cell[0, k], fraction[0, k] = _corner(position[k, 0], inv_cell, first_x, n_x)
        cell[1, k], fraction[1, k] = _corner(position[k, 1], inv_cell, first_y, n_y)
        cell[2, k], fraction[2, k] = _corner(position[k, 2], inv_cell, first_z, n_z)
    _scatter_plane(
        grad, xy, n_x * C, C, cell[0], cell[1], fraction[0], fraction[1], d_features, first
    )
    _scatter_plane(
        grad, xz, n_x * C, C, cell[0], cell[2], fraction[0], fraction[2], d_features, first
    )
    _scatter_plane(
        grad, yz, n_y * C, C, cell[1], cell[2], fraction[1], fraction[2], d_features, first
    )


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _scatter_plane(grad, offset, row, C, cell_u, cell_v, fraction_u, fraction_v, d_features, first):
    n, stride = d_features.shape
    zero = spread(np.float32(0.0))
    for c in range(first, first + C, 16):
        k = 0
        while k < n:
            i, j = cell_u[k], cell_v[k]
            s = s_u = s_v = s_uv = zero  # sums of d, fu d, fv d, fu fv d over the cell
            while k < n and cell_u[k] == i and cell_v[k] == j:
                fu, fv = fraction_u[k], fraction_v[k]
                d = load(d_features, k * stride + c)
                s = add(d, s)
                s_u = fma(spread(fu), d, s_u)
                s_v = fma(spread(fv), d, s_v)
                s_uv = fma(spread(fu * fv), d, s_uv)
                k += 1
            corner = offset + j * row + i * C
            o = corner + c - first
            u, v = sub(s_u, s_uv), sub(s_v, s_uv)
            store(grad.values, o, add(load(grad.values, o), sub(sub(s, s_u), v)))
            store(grad.values, o + C, add(load(grad.values, o + C), u))
            store(grad.values, o + row, add(load(grad.values, o + row), v))
            store(grad.values, o + row + C, add(load(grad.values, o + row + C), s_uv))
            if c == first:
                touch_rows(grad, corner, row, C)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def plane_position_gradient(params, layout, plane_set, position, d_features, first, d_position):
    """Add d(loss)/d(position) to d_position [n, 3] (1/m)."""
    C = layout.channels
    stride = d_features.shape[1]
    inv_cell, n_x, n_y, n_z, xy, xz, yz = _planes(layout, plane_set)
    first_x, first_y, first_z = _first_vertex(layout, plane_set)
    for k in range(position.shape[0]):
        x, fx = _corner(position[k, 0], inv_cell, first_x, n_x)
        y, fy = _corner(position[k, 1], inv_cell, first_y, n_y)
        z, fz = _corner(position[k, 2], inv_cell, first_z, n_z)
        o_xy = xy + (y * n_x + x) * C
        o_xz = xz + (z * n_x + x) * C
        o_yz = yz + (z * n_y + y) * C
        d_x = d_y = d_z = spread(np.float32(0.0))
        for c in range(0, C, 16):
            d = load(d_features, k * stride + first + c)
            u, v = _slopes(params, o_xy + c, C, n_x * C, fx, fy)
            d_x = fma(d, u, d_x)
            d_y = fma(d, v, d_y)
            u, v = _slopes(params, o_xz + c, C, n_x * C, fx, fz)
            d_x = fma(d, u, d_x)
            d_z = fma(d, v, d_z)
            u, v = _slopes(params, o_yz + c, C, n_y * C, fy, fz)
            d_y = fma(d, u, d_y)
            d_z = fma(d, v, d_z)
        d_position[k, 0] += inv_cell * total(d_x)
        d_position[k, 1] += inv_cell * total(d_y)
        d_position[k, 2] += inv_cell * total(d_z)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _planes(layout, s):
    """1 / cell, vertices along x, y, z, and the offsets of the xy, xz and yz planes of a set."""
    return (
        layout.plane_inv_cell[s],
        layout.plane_count[s, 0],
        layout.plane_count[s, 1],
        layout.plane_count[s, 2],
        layout.plane_offset[s, 0],
        layout.plane_offset[s, 1],
        layout.plane_offset[s, 2],
    )


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _first_vertex(layout, s):
    """The first vertex of a set's planes along x, y, z; not above 0."""
    return layout.plane_first[s, 0], layout.plane_first[s, 1], layout.plane_first[s, 2]


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _corner(x, inv_cell, first, n):
    """Lower vertex and fraction of a grid coordinate, clamped to the border."""
    g = min(max(x * inv_cell, np.float32(first)), np.float32(first + n - 1))
    i = min(int(np.floor(g)), first + n - 2)
    return i, g - np.float32(i)


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
