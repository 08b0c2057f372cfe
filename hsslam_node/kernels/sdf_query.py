"""SDF, its spatial gradient, and colour at free points: what tracker and mesher ask of the map."""

import numpy as np
from numba import njit

from hsslam_node.kernels.field_backward import one_blob_position_gradient
from hsslam_node.kernels.field_forward import BLOCK, HIDDEN, add_one_blob, relative_position, relu
from hsslam_node.kernels.hash_grid import gather_hash, hash_position_gradient
from hsslam_node.kernels.planes import gather_planes, plane_position_gradient


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def query_sdf(params, layout, points, sdf, inside, gradient, want_gradient):
    """SDF [N] in units of T at points [N, 3] (m, world) and, where asked, gradient [N, 3] (T/m).

    Reads the geometry prefix of `params` only. Outside the bound: sdf 1, inside 0, gradient 0.
    """
    L2 = 2 * layout.hash_offset.shape[0]
    C = layout.channels
    width = L2 + 2 * C
    rows = width + layout.blob_rows
    W1 = params[layout.geometry_W1 : layout.geometry_W1 + rows * HIDDEN].reshape(rows, HIDDEN)
    W2 = params[layout.geometry_W2 : layout.geometry_W2 + HIDDEN * 16].reshape(HIDDEN, 16)
    W1_T = W1[:width].T.copy()
    w2 = W2[:, 0].copy()
    n = points.shape[0]
    position = np.empty((BLOCK, 3), np.float32)
    x = np.empty((BLOCK, width), np.float32)
    hidden = np.empty((BLOCK, HIDDEN), np.float32)
    d_hidden = np.empty((BLOCK, HIDDEN), np.float32)
    d_x = np.empty((BLOCK, width), np.float32)
    for start in range(0, n, BLOCK):
        m = min(start + BLOCK, n) - start
        for k in range(m):
            inside[start + k] = relative_position(layout, points[start + k], position[k])
        gather_hash(params, layout, position[:m], x)
        for s in range(2):
            gather_planes(params, layout, s, position[:m], x, L2 + s * C)
        np.dot(x[:m], W1[:width], hidden[:m])
        add_one_blob(layout, position[:m], W1[width:], hidden[:m])
        relu(hidden[:m])
        for k in range(m):
            total = np.float32(0.0)
            for c in range(HIDDEN):
                total += hidden[k, c] * w2[c]
            s_k = np.tanh(total)
            sdf[start + k] = s_k if inside[start + k] else np.float32(1.0)
            if want_gradient:
                slope = np.float32(1.0) - s_k * s_k
                if inside[start + k] == 0:
                    slope = np.float32(0.0)
                for c in range(HIDDEN):
                    d_hidden[k, c] = slope * w2[c] if hidden[k, c] > 0 else np.float32(0.0)
        if want_gradient:
            np.dot(d_hidden[:m], W1_T, d_x[:m])
            d_position = gradient[start : start + m]
            d_position[:] = np.float32(0.0)
            hash_position_gradient(params, layout, position[:m], d_x, d_position)
            for s in range(2):
                plane_position_gradient(
                    params, layout, s, position[:m], d_x, L2 + s * C, d_position
                )
            one_blob_position_gradient(layout, position[:m], W1[width:], d_hidden, d_position)
