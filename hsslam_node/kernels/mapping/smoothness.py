"""Smoothness of the hash feature in a cube on the CPU, with its gradient.

Twin: `gpu_kernels/mapping/smoothness.py`. Reference: `reference/losses.py`.
"""

import numpy as np

from hsslam_node.kernels.compiled import njit
from hsslam_node.kernels.field.hash_grid import gather_hash, scatter_hash


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def smoothness_backward(params, layout, cube, scale, grad):
    """Returns the loss of the cube's vertices [n, n, n, 3] (m, world); adds `scale` times its gradient."""
    n = cube.shape[0]
    L = layout.hash_offset.shape[0]
    axes = np.empty((3, n**3), np.float32)
    for k in range(n**3):
        for a in range(3):
            axes[a, k] = cube[k // (n * n), k // n % n, k % n, a] - layout.origin[a]
    feature = np.empty((L, n**3, 2), np.float32)
    gather_hash(params, layout, axes, n**3, feature)
    d_feature = np.zeros((L, n**3, 2), np.float32)
    norm = np.float32(2.0 * scale / n**3)
    total = 0.0
    for level in range(L):
        value = feature[level].reshape(n, n, n, 2)
        d_value = d_feature[level].reshape(n, n, n, 2)
        total += _pull(value[1:], value[:-1], d_value[1:], d_value[:-1], norm)
        total += _pull(value[:, 1:], value[:, :-1], d_value[:, 1:], d_value[:, :-1], norm)
        total += _pull(
            value[:, :, 1:], value[:, :, :-1], d_value[:, :, 1:], d_value[:, :, :-1], norm
        )
    scatter_hash(grad, layout, axes, n**3, d_feature)
    return total / n**3


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _pull(a, b, d_a, d_b, norm):
    """Sum of squared differences of neighbours a and b, [., ., ., 2]; adds norm times them."""
    total = 0.0
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            for k in range(a.shape[2]):
                for f in range(2):
                    e = a[i, j, k, f] - b[i, j, k, f]
                    total += e * e
                    d_a[i, j, k, f] += norm * e
                    d_b[i, j, k, f] -= norm * e
    return total
