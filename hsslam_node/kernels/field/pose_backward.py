"""Backward pass of the hybrid field to the sample positions only, for a pose with a fixed map.

Twins: `gpu_kernels/field/pose_backward.py`, `gpu_kernels/field/position_backward.py`.
Reference: `reference/field.py`.
"""

import numpy as np

from hsslam_node.kernels.compiled import njit
from hsslam_node.kernels.field.backward import (
    color_logit_gradient,
    geometry_logit_gradient,
    mask_relu,
    put_feature_gradient,
)
from hsslam_node.kernels.field.decoder import HIDDEN, color_weights, geometry_weights
from hsslam_node.kernels.field.forward import split_hash_gradient
from hsslam_node.kernels.field.hash_grid import hash_position_gradient
from hsslam_node.kernels.field.layout import BLOCK
from hsslam_node.kernels.field.one_blob import (
    one_blob,
    one_blob_position_gradient,
    one_blob_space,
    padded_blob_rows,
)
from hsslam_node.kernels.field.planes import plane_position_gradient
from hsslam_node.kernels.simd import aligned_rows


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def field_pose_backward(params, layout, n, acts, d_sdf, d_rgb, d_points):
    """Write d_points [N, 3] (1/m) as `field_backward` does, without the gradient by the parameters.

    `acts` as the forward pass left it for the first n points; d_sdf [N], d_rgb [N, 3] are the loss
    gradients. Points outside the bound get zero.
    """
    d_points[:n] = np.float32(0.0)
    acts.d_geometry_out[:n] = np.float32(0.0)
    _color(params, layout, acts, d_rgb, d_points)
    geometry_logit_gradient(acts.inside, acts.sdf, d_sdf, acts.d_geometry_out[:n])
    _geometry(params, layout, n, acts, d_points)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _color(params, layout, acts, d_rgb, d_points):
    C = layout.channels
    V1, blob_V1, V2 = color_weights(params, layout)
    V1_T, V2_T = V1.T.copy(), V2.T.copy()
    d_logit, d_hidden = aligned_rows(BLOCK, 3), aligned_rows(BLOCK, HIDDEN)
    d_in, d_position = aligned_rows(BLOCK, 2 * C + 16), aligned_rows(BLOCK, 3)
    blob, blob_rows = one_blob_space(), padded_blob_rows(blob_V1)
    rows = acts.color_rows[0]
    for start in range(0, rows, BLOCK):
        stop = min(start + BLOCK, rows)
        m = stop - start
        point = acts.color_row[start:stop]
        color_logit_gradient(acts.inside, acts.rgb, point, d_rgb, d_logit)
        np.dot(d_logit[:m], V2_T, d_hidden[:m])
        mask_relu(acts.color_hidden[start:stop], d_hidden)
        np.dot(d_hidden[:m], V1_T, d_in[:m])
        d_position[:m] = np.float32(0.0)
        for s in range(2):
            plane_position_gradient(
                params, layout, 2 + s, acts.color_axes, start, d_in[:m], s * C, d_position[:m]
            )
        one_blob(layout, acts.color_axes, start, m, blob)
        one_blob_position_gradient(blob, blob_rows, d_hidden[:m], d_position[:m])
        put_feature_gradient(acts.d_geometry_out, point, d_in)
        for k in range(m):
            for a in range(3):
                d_points[point[k], a] += d_position[k, a]


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _geometry(params, layout, n, acts, d_points):
    L, C = layout.hash_offset.shape[0], layout.channels
    W1, blob_W1, W2 = geometry_weights(params, layout)
    W1_T, W2_T = W1.T.copy(), W2.T.copy()
    d_hidden, d_in = aligned_rows(BLOCK, HIDDEN), aligned_rows(BLOCK, 2 * L + 2 * C)
    blob, blob_rows = one_blob_space(), padded_blob_rows(blob_W1)
    for start in range(0, n, BLOCK):
        stop = min(start + BLOCK, n)
        m = stop - start
        d_position = d_points[start:stop]
        np.dot(acts.d_geometry_out[start:stop], W2_T, d_hidden[:m])
        mask_relu(acts.geometry_hidden[start:stop], d_hidden)
        np.dot(d_hidden[:m], W1_T, d_in[:m])
        split_hash_gradient(acts.hash_feature, start, d_in[:m])
        for s in range(2):
            plane_position_gradient(
                params, layout, s, acts.axes, start, d_in[:m], 2 * L + s * C, d_position
            )
        one_blob(layout, acts.axes, start, m, blob)
        one_blob_position_gradient(blob, blob_rows, d_hidden[:m], d_position)
    hash_position_gradient(params, layout, acts.axes, n, acts.hash_feature, d_points)
