"""Smoothness of the hash feature in a cube on the CPU, with its gradient (twin of losses/smoothness.py)."""

import numpy as np
from numba import njit

from hsslam_node.kernels.hash_grid import gather_hash, scatter_hash


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def smoothness_backward(params, layout, cube, scale, grad):
    """Returns the loss of the cube's vertices [n, n, n, 3] (m, world); adds `scale` times its gradient."""
    n = cube.shape[0]
    F = 2 * layout.hash_offset.shape[0]
    position = np.empty((n**3, 3), np.float32)
    for k in range(n**3):
        for a in range(3):
            position[k, a] = cube[k // (n * n), k // n % n, k % n, a] - layout.low[a]
    flat = np.empty((n**3, F), np.float32)
    gather_hash(params, layout, position, flat)
    feature = flat.reshape(n, n, n, F)
    d_flat = np.zeros((n**3, F), np.float32)
    d_feature = d_flat.reshape(n, n, n, F)
    total = 0.0
    norm = np.float32(2.0 * scale / n**3)
    for i in range(n):
        for j in range(n):
            for k in range(n):
                for di, dj, dk in ((1, 0, 0), (0, 1, 0), (0, 0, 1)):
                    if i + di < n and j + dj < n and k + dk < n:
                        a = feature[i, j, k]
                        b = feature[i + di, j + dj, k + dk]
                        for f in range(F):
                            e = b[f] - a[f]
                            total += e * e
                            d_feature[i + di, j + dj, k + dk, f] += norm * e
                            d_feature[i, j, k, f] -= norm * e
    scatter_hash(grad.values, grad.touched, layout, position, d_flat)
    return total / n**3
