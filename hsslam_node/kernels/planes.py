"""Tri-plane look-ups on the CPU: bilinear gather, its scatter, and its derivative by position.

All take a block of positions [n, 3] (m, relative to the low corner) and C columns of a feature
matrix [n, W] from column `first` on. Channels are innermost and a multiple of 16, so each corner is
one or two vector operations; planes are the outer loop, so their rows stay in the cache. Without
channels nothing is done.
"""

import numpy as np
from numba import njit


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def gather_planes(params, layout, plane_set, position, features, first):
    """Sum of the three planes' features."""
    C = layout.channels
    if C == 0:
        return
    inv_cell = layout.plane_inv_cell[plane_set]
    for plane in range(3):
        u, v, n_u, n_v, offset = _plane(layout, plane_set, plane)
        for k in range(position.shape[0]):
            i, fu = _corner(position[k, u], inv_cell, n_u)
            j, fv = _corner(position[k, v], inv_cell, n_v)
            o00 = offset + (j * n_u + i) * C
            o10 = o00 + n_u * C
            w11 = fu * fv
            w01 = fu - w11
            w10 = fv - w11
            w00 = np.float32(1.0) - fu - fv + w11
            a = params[o00 : o00 + 2 * C]
            b = params[o10 : o10 + 2 * C]
            out = features[k]
            if plane == 0:
                for c in range(C):
                    out[first + c] = w00 * a[c] + w01 * a[C + c] + w10 * b[c] + w11 * b[C + c]
            else:
                for c in range(C):
                    out[first + c] += w00 * a[c] + w01 * a[C + c] + w10 * b[c] + w11 * b[C + c]


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def scatter_planes(grad, touched, layout, plane_set, position, d_features, first):
    """Add the gradient of `gather_planes` and mark the 16-float chunks it lies in."""
    C = layout.channels
    if C == 0:
        return
    inv_cell = layout.plane_inv_cell[plane_set]
    chunks = 2 * (C >> 4)
    for plane in range(3):
        u, v, n_u, n_v, offset = _plane(layout, plane_set, plane)
        for k in range(position.shape[0]):
            i, fu = _corner(position[k, u], inv_cell, n_u)
            j, fv = _corner(position[k, v], inv_cell, n_v)
            o00 = offset + (j * n_u + i) * C
            o10 = o00 + n_u * C
            w11 = fu * fv
            w01 = fu - w11
            w10 = fv - w11
            w00 = np.float32(1.0) - fu - fv + w11
            d = d_features[k, first : first + C]
            # one loop a corner: fused, the rows may alias and nothing is vectorised
            a = grad[o00 : o00 + C]
            for c in range(C):
                a[c] += w00 * d[c]
            a = grad[o00 + C : o00 + 2 * C]
            for c in range(C):
                a[c] += w01 * d[c]
            a = grad[o10 : o10 + C]
            for c in range(C):
                a[c] += w10 * d[c]
            a = grad[o10 + C : o10 + 2 * C]
            for c in range(C):
                a[c] += w11 * d[c]
            for chunk in range(chunks):
                touched[(o00 >> 4) + chunk] = 1
                touched[(o10 >> 4) + chunk] = 1


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def plane_position_gradient(params, layout, plane_set, position, d_features, first, d_position):
    """Add d(loss)/d(position) to d_position [n, 3] (1/m); zero across a clamped border."""
    C = layout.channels
    if C == 0:
        return
    inv_cell = layout.plane_inv_cell[plane_set]
    for plane in range(3):
        u, v, n_u, n_v, offset = _plane(layout, plane_set, plane)
        for k in range(position.shape[0]):
            i, fu = _corner(position[k, u], inv_cell, n_u)
            j, fv = _corner(position[k, v], inv_cell, n_v)
            o00 = offset + (j * n_u + i) * C
            o10 = o00 + n_u * C
            a = params[o00 : o00 + 2 * C]
            b = params[o10 : o10 + 2 * C]
            d = d_features[k]
            d00 = np.float32(0.0)
            d01 = np.float32(0.0)
            d10 = np.float32(0.0)
            d11 = np.float32(0.0)
            for c in range(C):
                d00 += d[first + c] * a[c]
                d01 += d[first + c] * a[C + c]
                d10 += d[first + c] * b[c]
                d11 += d[first + c] * b[C + c]
            twist = d11 - d10 - d01 + d00
            d_position[k, u] += inv_cell * (d01 - d00 + fv * twist)
            d_position[k, v] += inv_cell * (d10 - d00 + fu * twist)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _plane(layout, plane_set, plane):
    """World axes u and v, vertices along them, and offset of one plane."""
    return (
        layout.plane_axes[plane, 0],
        layout.plane_axes[plane, 1],
        layout.plane_resolution[plane_set, plane, 0],
        layout.plane_resolution[plane_set, plane, 1],
        layout.plane_offset[plane_set, plane],
    )


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _corner(x, inv_cell, n):
    """Lower vertex and fraction of a grid coordinate, clamped to the border."""
    g = min(max(x * inv_cell, np.float32(0.0)), np.float32(n - 1))
    i = min(int(g), n - 2)
    return i, g - np.float32(i)
