"""Tri-plane look-ups on the CPU: bilinear gather, its scatter, and its derivative by position.

Channels are innermost and a multiple of 16, so each corner is one or two vector operations.
"""

import numpy as np
from numba import njit


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _corner(x, inv_cell, n):
    """Lower vertex and fraction of a grid coordinate, clamped to the border."""
    g = x * inv_cell
    top = np.float32(n - 1)
    if g < np.float32(0.0):
        g = np.float32(0.0)
    if g > top:
        g = top
    i = int(g)
    if i > n - 2:
        i = n - 2
    return i, g - np.float32(i)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def gather_planes(params, layout, plane_set, p, out):
    """Sum of the three planes' features at p [3] (m, relative to the low corner); out [C]."""
    C = layout.channels
    for c in range(C):
        out[c] = np.float32(0.0)
    inv_cell = layout.plane_inv_cell[plane_set]
    for plane in range(3):
        n_u = layout.plane_resolution[plane_set, plane, 0]
        n_v = layout.plane_resolution[plane_set, plane, 1]
        i, fu = _corner(p[layout.plane_axes[plane, 0]], inv_cell, n_u)
        j, fv = _corner(p[layout.plane_axes[plane, 1]], inv_cell, n_v)
        o00 = layout.plane_offset[plane_set, plane] + (j * n_u + i) * C
        o10 = o00 + n_u * C
        w11 = fu * fv
        w01 = fu - w11
        w10 = fv - w11
        w00 = np.float32(1.0) - fu - fv + w11
        a = params[o00 : o00 + 2 * C]
        b = params[o10 : o10 + 2 * C]
        for c in range(C):
            out[c] += w00 * a[c] + w01 * a[C + c] + w10 * b[c] + w11 * b[C + c]


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def scatter_planes(grad, touched, layout, plane_set, p, d_out):
    """Add the gradient of `gather_planes` and mark the 16-float chunks it lies in."""
    C = layout.channels
    inv_cell = layout.plane_inv_cell[plane_set]
    for plane in range(3):
        n_u = layout.plane_resolution[plane_set, plane, 0]
        n_v = layout.plane_resolution[plane_set, plane, 1]
        i, fu = _corner(p[layout.plane_axes[plane, 0]], inv_cell, n_u)
        j, fv = _corner(p[layout.plane_axes[plane, 1]], inv_cell, n_v)
        o00 = layout.plane_offset[plane_set, plane] + (j * n_u + i) * C
        o10 = o00 + n_u * C
        w11 = fu * fv
        w01 = fu - w11
        w10 = fv - w11
        w00 = np.float32(1.0) - fu - fv + w11
        a = grad[o00 : o00 + C]
        for c in range(C):
            a[c] += w00 * d_out[c]
        b = grad[o00 + C : o00 + 2 * C]
        for c in range(C):
            b[c] += w01 * d_out[c]
        d = grad[o10 : o10 + C]
        for c in range(C):
            d[c] += w10 * d_out[c]
        e = grad[o10 + C : o10 + 2 * C]
        for c in range(C):
            e[c] += w11 * d_out[c]
        for k in range(2 * (C >> 4)):
            touched[(o00 >> 4) + k] = 1
            touched[(o10 >> 4) + k] = 1


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def plane_position_gradient(params, layout, plane_set, p, d_out, d_p):
    """Add d_out [C] . d(features)/d(p) to d_p [3] (1/m); zero across a clamped border."""
    C = layout.channels
    inv_cell = layout.plane_inv_cell[plane_set]
    for plane in range(3):
        u = layout.plane_axes[plane, 0]
        v = layout.plane_axes[plane, 1]
        n_u = layout.plane_resolution[plane_set, plane, 0]
        n_v = layout.plane_resolution[plane_set, plane, 1]
        i, fu = _corner(p[u], inv_cell, n_u)
        j, fv = _corner(p[v], inv_cell, n_v)
        o00 = layout.plane_offset[plane_set, plane] + (j * n_u + i) * C
        o10 = o00 + n_u * C
        a = params[o00 : o00 + 2 * C]
        b = params[o10 : o10 + 2 * C]
        d00 = np.float32(0.0)
        d01 = np.float32(0.0)
        d10 = np.float32(0.0)
        d11 = np.float32(0.0)
        for c in range(C):
            d00 += d_out[c] * a[c]
            d01 += d_out[c] * a[C + c]
            d10 += d_out[c] * b[c]
            d11 += d_out[c] * b[C + c]
        d_p[u] += inv_cell * ((d01 - d00) + fv * (d11 - d10 - d01 + d00))
        d_p[v] += inv_cell * ((d10 - d00) + fu * (d11 - d10 - d01 + d00))
