"""Multi-resolution hash grid on the CPU: trilinear gather, its scatter, its derivative by position.

The eight corners are unrolled by hand: as a loop with per-corner choices this takes ten times as long.
"""

import numpy as np
from numba import njit

PRIME_Y = 2654435761
PRIME_Z = 805459861


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def gather_hash(params, layout, p, out):
    """Features of all levels at p [3] (m, relative to the low corner); out [2 L]."""
    one = np.float32(1.0)
    for level in range(layout.hash_offset.shape[0]):
        x, fx, y, fy, z, fz = _cell(layout, level, p)
        o0, o1, o2, o3, o4, o5, o6, o7 = _corners(layout, level, x, y, z)
        gx, gy, gz = one - fx, one - fy, one - fz
        w00, w10, w01, w11 = gy * gz, fy * gz, gy * fz, fy * fz
        out[2 * level] = gx * (
            w00 * params[o0] + w10 * params[o2] + w01 * params[o4] + w11 * params[o6]
        ) + fx * (w00 * params[o1] + w10 * params[o3] + w01 * params[o5] + w11 * params[o7])
        out[2 * level + 1] = gx * (
            w00 * params[o0 + 1]
            + w10 * params[o2 + 1]
            + w01 * params[o4 + 1]
            + w11 * params[o6 + 1]
        ) + fx * (
            w00 * params[o1 + 1]
            + w10 * params[o3 + 1]
            + w01 * params[o5 + 1]
            + w11 * params[o7 + 1]
        )


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def scatter_hash(grad, touched, layout, p, d_out):
    """Add the gradient of `gather_hash` and mark the 16-float chunks it lies in."""
    one = np.float32(1.0)
    for level in range(layout.hash_offset.shape[0]):
        da = d_out[2 * level]
        db = d_out[2 * level + 1]
        x, fx, y, fy, z, fz = _cell(layout, level, p)
        o0, o1, o2, o3, o4, o5, o6, o7 = _corners(layout, level, x, y, z)
        gx, gy, gz = one - fx, one - fy, one - fz
        for o, w in (
            (o0, gx * gy * gz),
            (o1, fx * gy * gz),
            (o2, gx * fy * gz),
            (o3, fx * fy * gz),
            (o4, gx * gy * fz),
            (o5, fx * gy * fz),
            (o6, gx * fy * fz),
            (o7, fx * fy * fz),
        ):
            grad[o] += w * da
            grad[o + 1] += w * db
            touched[o >> 4] = 1


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def hash_position_gradient(params, layout, p, d_out, d_p):
    """Add d_out [2 L] . d(features)/d(p) to d_p [3] (1/m)."""
    one = np.float32(1.0)
    for level in range(layout.hash_offset.shape[0]):
        da = d_out[2 * level]
        db = d_out[2 * level + 1]
        x, fx, y, fy, z, fz = _cell(layout, level, p)
        o0, o1, o2, o3, o4, o5, o6, o7 = _corners(layout, level, x, y, z)
        v0 = da * params[o0] + db * params[o0 + 1]
        v1 = da * params[o1] + db * params[o1 + 1]
        v2 = da * params[o2] + db * params[o2 + 1]
        v3 = da * params[o3] + db * params[o3 + 1]
        v4 = da * params[o4] + db * params[o4 + 1]
        v5 = da * params[o5] + db * params[o5 + 1]
        v6 = da * params[o6] + db * params[o6 + 1]
        v7 = da * params[o7] + db * params[o7 + 1]
        gx, gy, gz = one - fx, one - fy, one - fz
        scale = layout.hash_scale[level]
        d_p[0] += scale * (
            gz * (gy * (v1 - v0) + fy * (v3 - v2)) + fz * (gy * (v5 - v4) + fy * (v7 - v6))
        )
        d_p[1] += scale * (
            gz * (gx * (v2 - v0) + fx * (v3 - v1)) + fz * (gx * (v6 - v4) + fx * (v7 - v5))
        )
        d_p[2] += scale * (
            gy * (gx * (v4 - v0) + fx * (v5 - v1)) + fy * (gx * (v6 - v2) + fx * (v7 - v3))
        )


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _cell(layout, level, p):
    """Lower vertex and fraction along x, y, z."""
    scale = layout.hash_scale[level]
    last = layout.hash_resolution[level] - 1
    gx = max(p[0] * scale, np.float32(0.0))
    gy = max(p[1] * scale, np.float32(0.0))
    gz = max(p[2] * scale, np.float32(0.0))
    x = min(int(gx), last)
    y = min(int(gy), last)
    z = min(int(gz), last)
    return x, gx - np.float32(x), y, gy - np.float32(y), z, gz - np.float32(z)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _corners(layout, level, x, y, z):
    """Offsets in floats of the eight vertices (x fastest): dense, or XOR hash (Instant-NGP, eq. 4)."""
    first = layout.hash_offset[level]
    mask = layout.hash_mask[level]
    if mask == 0:
        n = layout.hash_resolution[level] + 1
        o = first + 2 * (x + n * (y + n * z))
        row = 2 * n
        slab = 2 * n * n
        return (
            o,
            o + 2,
            o + row,
            o + row + 2,
            o + slab,
            o + slab + 2,
            o + slab + row,
            o + slab + row + 2,
        )
    y0 = y * PRIME_Y
    y1 = y0 + PRIME_Y
    z0 = z * PRIME_Z
    z1 = z0 + PRIME_Z
    a, b, c, d = y0 ^ z0, y1 ^ z0, y0 ^ z1, y1 ^ z1
    x1 = x + 1
    return (
        first + 2 * ((x ^ a) & mask),
        first + 2 * ((x1 ^ a) & mask),
        first + 2 * ((x ^ b) & mask),
        first + 2 * ((x1 ^ b) & mask),
        first + 2 * ((x ^ c) & mask),
        first + 2 * ((x1 ^ c) & mask),
        first + 2 * ((x ^ d) & mask),
        first + 2 * ((x1 ^ d) & mask),
    )
