"""Backward pass of the hybrid field to the sample positions alone, for a pose with the map held still."""

import numpy as np
from numba import njit

from hsslam_node.kernels.field_backward import one_blob_position_gradient
from hsslam_node.kernels.field_forward import BLOCK, HIDDEN, color_first_layer
from hsslam_node.kernels.hash_grid import hash_position_gradient
from hsslam_node.kernels.planes import plane_position_gradient


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def field_pose_backward(params, layout, n, acts, d_sdf, d_rgb, d_points):
    """Write d_points [N, 3] (1/m): what `field_backward` writes, without any parameter's gradient.

    `acts` as `field_forward` left it for the first n points; d_sdf [N], d_rgb [N, 3] are the loss
    gradients. Points outside the bound get zero.
    """
    L2 = 2 * layout.hash_offset.shape[0]
    C = layout.channels
    width = L2 + 2 * C
    rows = width + layout.blob_rows
    W1 = params[layout.geometry_W1 : layout.geometry_W1 + rows * HIDDEN].reshape(rows, HIDDEN)
    W2 = params[layout.geometry_W2 : layout.geometry_W2 + HIDDEN * 16].reshape(HIDDEN, 16)
    V1, blob_V1 = color_first_layer(params, layout)
    V2 = params[layout.color_W2 : layout.color_W2 + HIDDEN * 3].reshape(HIDDEN, 3)
    W1_T = W1[:width].T.copy()
    W2_T = W2.T.copy()
    V1_T = V1.T.copy()
    V2_T = V2.T.copy()
    d_logit = np.empty((BLOCK, 3), np.float32)
    d_color_hidden = np.empty((BLOCK, HIDDEN), np.float32)
    d_color_in = np.empty((BLOCK, 2 * C + 16), np.float32)
    d_out = np.empty((BLOCK, 16), np.float32)
    d_hidden = np.empty((BLOCK, HIDDEN), np.float32)
    d_in = np.empty((BLOCK, width), np.float32)
    for start in range(0, n, BLOCK):
        stop = min(start + BLOCK, n)
        m = stop - start
        for k in range(m):
            live = np.float32(acts.inside[start + k])
            for c in range(3):
                v = acts.rgb[start + k, c]
                d_logit[k, c] = live * d_rgb[start + k, c] * v * (np.float32(1.0) - v)
        np.dot(d_logit[:m], V2_T, d_color_hidden[:m])
        _mask_inactive(acts.color_hidden[start:stop], d_color_hidden[:m])
        np.dot(d_color_hidden[:m], V1_T, d_color_in[:m])
        for k in range(m):
            for c in range(1, 16):
                d_out[k, c] = d_color_in[k, 2 * C + c]
            s = acts.sdf[start + k]
            live = np.float32(acts.inside[start + k])
            d_out[k, 0] = live * d_sdf[start + k] * (np.float32(1.0) - s * s)
        np.dot(d_out[:m], W2_T, d_hidden[:m])
        _mask_inactive(acts.geometry_hidden[start:stop], d_hidden[:m])
        np.dot(d_hidden[:m], W1_T, d_in[:m])
        position, d_position = acts.position[start:stop], d_points[start:stop]
        d_position[:] = np.float32(0.0)
        hash_position_gradient(params, layout, position, d_in[:m], d_position)
        for s in range(2):
            plane_position_gradient(params, layout, s, position, d_in[:m], L2 + s * C, d_position)
            plane_position_gradient(
                params, layout, 2 + s, position, d_color_in[:m], s * C, d_position
            )
        one_blob_position_gradient(layout, position, W1[width:], d_hidden[:m], d_position)
        one_blob_position_gradient(layout, position, blob_V1, d_color_hidden[:m], d_position)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _mask_inactive(hidden, d_hidden):
    """No gradient through units that the ReLU has set to zero."""
    for k in range(hidden.shape[0]):
        for c in range(HIDDEN):
            if hidden[k, c] <= np.float32(0.0):
                d_hidden[k, c] = np.float32(0.0)
