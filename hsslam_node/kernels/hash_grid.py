"""Multi-resolution hash grid on the CPU: trilinear gather, its scatter, its derivative by position.

All take a block of positions [n, 3] (m, relative to the low corner) and the first 2 L columns of a
feature matrix [n, W]. Levels are the outer loop, so one table at a time is in the cache. The eight
corners are unrolled by hand: as a loop with per-corner choices this takes ten times as long.
"""

import numpy as np
from numba import njit

PRIME_Y = 2654435761
PRIME_Z = 805459861


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def gather_hash(params, layout, position, features):
    """Features of all levels."""
    one = np.float32(1.0)
    for level in range(layout.hash_offset.shape[0]):
        first, mask, scale, last = _level(layout, level)
        for k in range(position.shape[0]):
            x, fx = _cell(position[k, 0], scale, last)
            y, fy = _cell(position[k, 1], scale, last)
            z, fz = _cell(position[k, 2], scale, last)
            o0, o1, o2, o3, o4, o5, o6, o7 = _corners(first, mask, last, x, y, z)
            gx, gy, gz = one - fx, one - fy, one - fz
            w00, w10, w01, w11 = gy * gz, fy * gz, gy * fz, fy * fz
            features[k, 2 * level] = gx * (
                w00 * params[o0] + w10 * params[o2] + w01 * params[o4] + w11 * params[o6]
            ) + fx * (w00 * params[o1] + w10 * params[o3] + w01 * params[o5] + w11 * params[o7])
            features[k, 2 * level + 1] = gx * (
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
def scatter_hash(grad, touched, layout, position, d_features):
    """Add the gradient of `gather_hash` and mark the 16-float chunks it lies in."""
    one = np.float32(1.0)
    for level in range(layout.hash_offset.shape[0]):
        first, mask, scale, last = _level(layout, level)
        for k in range(position.shape[0]):
            da = d_features[k, 2 * level]
            db = d_features[k, 2 * level + 1]
            x, fx = _cell(position[k, 0], scale, last)
            y, fy = _cell(position[k, 1], scale, last)
            z, fz = _cell(position[k, 2], scale, last)
            o0, o1, o2, o3, o4, o5, o6, o7 = _corners(first, mask, last, x, y, z)
            gx, gy, gz = one - fx, one - fy, one - fz
            _add(grad, touched, o0, gx * gy * gz, da, db)
            _add(grad, touched, o1, fx * gy * gz, da, db)
            _add(grad, touched, o2, gx * fy * gz, da, db)
            _add(grad, touched, o3, fx * fy * gz, da, db)
            _add(grad, touched, o4, gx * gy * fz, da, db)
            _add(grad, touched, o5, fx * gy * fz, da, db)
            _add(grad, touched, o6, gx * fy * fz, da, db)
            _add(grad, touched, o7, fx * fy * fz, da, db)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def hash_position_gradient(params, layout, position, d_features, d_position):
    """Add d(loss)/d(position) to d_position [n, 3] (1/m)."""
    one = np.float32(1.0)
    for level in range(layout.hash_offset.shape[0]):
        first, mask, scale, last = _level(layout, level)
        for k in range(position.shape[0]):
            da = d_features[k, 2 * level]
            db = d_features[k, 2 * level + 1]
            x, fx = _cell(position[k, 0], scale, last)
            y, fy = _cell(position[k, 1], scale, last)
            z, fz = _cell(position[k, 2], scale, last)
            o0, o1, o2, o3, o4, o5, o6, o7 = _corners(first, mask, last, x, y, z)
            v0 = da * params[o0] + db * params[o0 + 1]
            v1 = da * params[o1] + db * params[o1 + 1]
            v2 = da * params[o2] + db * params[o2 + 1]
            v3 = da * params[o3] + db * params[o3 + 1]
            v4 = da * params[o4] + db * params[o4 + 1]
            v5 = da * params[o5] + db * params[o5 + 1]
            v6 = da * params[o6] + db * params[o6 + 1]
            v7 = da * params[o7] + db * params[o7 + 1]
            gx, gy, gz = one - fx, one - fy, one - fz
            d_position[k, 0] += scale * (
                gz * (gy * (v1 - v0) + fy * (v3 - v2)) + fz * (gy * (v5 - v4) + fy * (v7 - v6))
            )
            d_position[k, 1] += scale * (
                gz * (gx * (v2 - v0) + fx * (v3 - v1)) + fz * (gx * (v6 - v4) + fx * (v7 - v5))
            )
            d_position[k, 2] += scale * (
                gy * (gx * (v4 - v0) + fx * (v5 - v1)) + fy * (gx * (v6 - v2) + fx * (v7 - v3))
            )


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _level(layout, level):
    """Offset in floats, hash mask (0: dense), cells per metre and last cell of a level."""
    return (
        layout.hash_offset[level],
        layout.hash_mask[level],
        layout.hash_scale[level],
        layout.hash_resolution[level] - 1,
    )


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _cell(x, scale, last):
    """Lower vertex and fraction along one axis."""
    g = max(x * scale, np.float32(0.0))
    i = min(int(g), last)
    return i, g - np.float32(i)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _add(grad, touched, o, w, da, db):
    grad[o] += w * da
    grad[o + 1] += w * db
    touched[o >> 4] = 1


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _corners(first, mask, last, x, y, z):
    """Offsets in floats of the eight vertices (x fastest): dense, or XOR hash (Instant-NGP, eq. 4)."""
    if mask == 0:
        n = last + 2
        o = first + 2 * (x + n * (y + n * z))
        row = 2 * n
        slab = 2 * n * n
        far = o + slab
        return o, o + 2, o + row, o + row + 2, far, far + 2, far + row, far + row + 2
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
