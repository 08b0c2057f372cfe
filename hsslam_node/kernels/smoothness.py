"""Smoothness of the hash feature in a cube on the CPU, with its gradient (twin of losses/smoothness.py)."""

import numpy as np
from numba import njit

from hsslam_node.kernels.hash_grid import gather_hash, scatter_hash


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def smoothness_backward(params, layout, cube, scale, grad):
    """Returns the loss of the cube's vertices [n, n, n, 3] (m, world); adds `scale` times its gradient."""
    n = cube.shape[0]
    F = 2 * layout.hash_offset.shape[0]
    feature = np.empty((n, n, n, F), np.float32)
    d_feature = np.zeros((n, n, n, F), np.float32)
    p = np.empty(3, np.float32)
    for i in range(n):
        for j in range(n):
            for k in range(n):
                for a in range(3):
                    p[a] = cube[i, j, k, a] - layout.low[a]
                gather_hash(params, layout, p, feature[i, j, k])
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
    for i in range(n):
        for j in range(n):
            for k in range(n):
                for a in range(3):
                    p[a] = cube[i, j, k, a] - layout.low[a]
                scatter_hash(grad.values, grad.touched, layout, p, d_feature[i, j, k])
    return total / n**3
