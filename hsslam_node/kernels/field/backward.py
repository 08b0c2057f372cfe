"""Backward pass of the hybrid field on the CPU: to the parameters, and to the sample positions.

Twins: `gpu_kernels/field/backward.py`, `gpu_kernels/field/decoder_backward.py`.
Reference: `reference/field.py`.
"""

import numpy as np

from hsslam_node.kernels.compiled import njit
from hsslam_node.kernels.field.decoder import (
    HIDDEN,
    color_first_layer,
    color_weights,
    geometry_weights,
)
from hsslam_node.kernels.field.forward import split_hash_gradient
from hsslam_node.kernels.field.gradient import touch_range
from hsslam_node.kernels.field.hash_grid import hash_position_gradient, scatter_hash
from hsslam_node.kernels.field.layout import BLOCK
from hsslam_node.kernels.field.one_blob import (
    add_blob_gradient,
    one_blob,
    one_blob_position_gradient,
    one_blob_space,
    padded_blob_rows,
    scatter_one_blob,
)
from hsslam_node.kernels.field.planes import plane_position_gradient, scatter_planes
from hsslam_node.kernels.simd import aligned_rows, fma, load, mul, spread, store, where_positive


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def field_backward(params, layout, n, acts, d_sdf, d_rgb, grad, d_points, want_points):
    """Add the parameter gradient to `grad`; if `want_points`, write d_points [N, 3] (1/m).

    `acts` as the forward pass left it for the first n points; d_sdf [N], d_rgb [N, 3] are the loss
    gradients. Points outside the bound contribute nothing, nor does d_rgb of points without colour.
    """
    if n == 0:
        return
    if want_points:
        d_points[:n] = np.float32(0.0)
    acts.d_geometry_out[:n] = np.float32(0.0)
    _color_backward(params, layout, acts, d_rgb, grad, d_points, want_points)
    geometry_logit_gradient(acts.inside, acts.sdf, d_sdf, acts.d_geometry_out[:n])
    _geometry_backward(params, layout, n, acts, grad, d_points, want_points)
    touch_range(grad, layout.geometry_W1, layout.color_W2 + HIDDEN * 3)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _color_backward(params, layout, acts, d_rgb, grad, d_points, want_points):
    """Colour decoder and appearance planes; the geometry feature's gradient into d_geometry_out."""
    C = layout.channels
    V1, blob_V1, V2 = color_weights(params, layout)
    V1_T, V2_T = V1.T.copy(), V2.T.copy()
    d_V, d_blob, d_feature_V = color_first_layer(grad.values, layout)
    d_V2 = color_weights(grad.values, layout)[2]
    d_hidden = aligned_rows(BLOCK, HIDDEN)
    d_in = aligned_rows(BLOCK, 2 * C + 16)
    d_logit = aligned_rows(BLOCK, 3)
    d_V2_T = np.zeros((3, HIDDEN), np.float32)
    product = aligned_rows(2 * C + 16, HIDDEN)
    d_position = aligned_rows(BLOCK, 3)
    blob, blob_rows = one_blob_space(), padded_blob_rows(blob_V1)
    d_blob_rows = np.zeros_like(blob_rows)
    rows = acts.color_rows[0]
    for start in range(0, rows, BLOCK):
        stop = min(start + BLOCK, rows)
        m = stop - start
        hidden, point = acts.color_hidden[start:stop], acts.color_row[start:stop]
        color_logit_gradient(acts.inside, acts.rgb, point, d_rgb, d_logit)
        _narrow_layer_backward(hidden, d_logit, V2_T, d_V2_T, d_hidden)
        np.dot(d_hidden[:m], V1_T, d_in[:m])
        np.dot(acts.color_in[start:stop].T, d_hidden[:m], product)
        d_V += product[: 2 * C]
        d_feature_V += product[2 * C + 1 :]
        one_blob(layout, acts.color_axes, start, m, blob)
        scatter_one_blob(blob, d_hidden[:m], d_blob_rows)
        put_feature_gradient(acts.d_geometry_out, point, d_in)
        for s in range(2):
            scatter_planes(grad, layout, 2 + s, acts.color_axes, start, d_in[:m], s * C)
        if want_points:
            d_position[:m] = np.float32(0.0)
            for s in range(2):
                plane_position_gradient(
                    params, layout, 2 + s, acts.color_axes, start, d_in[:m], s * C, d_position[:m]
                )
            one_blob_position_gradient(blob, blob_rows, d_hidden[:m], d_position[:m])
            for k in range(m):
                for a in range(3):
                    d_points[point[k], a] += d_position[k, a]
    add_blob_gradient(d_blob_rows, d_blob)
    for c in range(3):
        for h in range(HIDDEN):
            d_V2[h, c] += d_V2_T[c, h]


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _geometry_backward(params, layout, n, acts, grad, d_points, want_points):
    """Geometry decoder, planes and hash grid from d_geometry_out."""
    L, C = layout.hash_offset.shape[0], layout.channels
    W1, blob_W1, W2 = geometry_weights(params, layout)
    W1_T, W2_T = W1.T.copy(), W2.T.copy()
    d_W1, d_blob, d_W2 = geometry_weights(grad.values, layout)
    d_hidden = aligned_rows(BLOCK, HIDDEN)
    d_in = aligned_rows(BLOCK, 2 * L + 2 * C)
    product_W1 = aligned_rows(2 * L + 2 * C, HIDDEN)
    product_W2 = aligned_rows(HIDDEN, 16)
    blob, blob_rows = one_blob_space(), padded_blob_rows(blob_W1)
    d_blob_rows = np.zeros_like(blob_rows)
    for start in range(0, n, BLOCK):
        stop = min(start + BLOCK, n)
        m = stop - start
        hidden = acts.geometry_hidden[start:stop]
        d_out = acts.d_geometry_out[start:stop]
        _layer_backward(hidden, d_out, W2_T, product_W2, d_W2, d_hidden[:m])
        mask_relu(hidden, d_hidden)
        _layer_backward(
            acts.geometry_in[start:stop], d_hidden[:m], W1_T, product_W1, d_W1, d_in[:m]
        )
        one_blob(layout, acts.axes, start, m, blob)
        scatter_one_blob(blob, d_hidden[:m], d_blob_rows)
        split_hash_gradient(acts.hash_feature, start, d_in[:m])
        for s in range(2):
            scatter_planes(grad, layout, s, acts.axes, start, d_in[:m], 2 * L + s * C)
        if want_points:
            d_position = d_points[start:stop]
            for s in range(2):
                plane_position_gradient(
                    params, layout, s, acts.axes, start, d_in[:m], 2 * L + s * C, d_position
                )
            one_blob_position_gradient(blob, blob_rows, d_hidden[:m], d_position)
    add_blob_gradient(d_blob_rows, d_blob)
    scatter_hash(grad, layout, acts.axes, n, acts.hash_feature)
    if want_points:
        hash_position_gradient(params, layout, acts.axes, n, acts.hash_feature, d_points)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def color_logit_gradient(inside, rgb, point, d_rgb, d_logit):
    """d_logit [n, 3], before the sigmoid, of the colours of points [n]; zero outside the bound."""
    for k in range(point.shape[0]):
        live = np.float32(inside[point[k]])
        for c in range(3):
            v = rgb[point[k], c]
            d_logit[k, c] = live * d_rgb[point[k], c] * v * (np.float32(1.0) - v)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def put_feature_gradient(d_geometry_out, point, d_in):
    """The last 16 columns of d_in [m, W] into rows `point` [m]; column 0, the SDF's, comes later."""
    stride = d_in.shape[1]
    for k in range(point.shape[0]):
        store(d_geometry_out, 16 * point[k], load(d_in, (k + 1) * stride - 16))


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def geometry_logit_gradient(inside, sdf, d_sdf, d_geometry_out):
    """Column 0 of d_geometry_out [n, 16], before the tanh; zero outside the bound."""
    for k in range(d_geometry_out.shape[0]):
        live = np.float32(inside[k])
        d_geometry_out[k, 0] = live * d_sdf[k] * (np.float32(1.0) - sdf[k] * sdf[k])


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def mask_relu(hidden, d_hidden):
    """Zero the gradient of units of hidden [n, 32] that the ReLU has set to zero."""
    for o in range(0, hidden.shape[0] * HIDDEN, 16):
        store(d_hidden, o, where_positive(load(hidden, o), load(d_hidden, o)))


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _layer_backward(x, d_y, W_T, product, dW, d_x):
    """Linear layer y = x W: dW += x^T d_y, d_x = d_y W^T."""
    np.dot(x.T, d_y, product)
    dW += product
    np.dot(d_y, W_T, d_x)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _narrow_layer_backward(hidden, d_y, V_T, d_V_T, d_hidden):
    """y = ReLU(..) V with three columns: d_V_T [3, 32] += (hidden^T d_y)^T, d_hidden before the ReLU."""
    for half in range(0, HIDDEN, 16):
        v0, v1, v2 = load(V_T, half), load(V_T, HIDDEN + half), load(V_T, 2 * HIDDEN + half)
        s0, s1 = load(d_V_T, half), load(d_V_T, HIDDEN + half)
        s2 = load(d_V_T, 2 * HIDDEN + half)
        for k in range(hidden.shape[0]):
            h = load(hidden, HIDDEN * k + half)
            y0, y1, y2 = spread(d_y[k, 0]), spread(d_y[k, 1]), spread(d_y[k, 2])
            s0, s1, s2 = fma(h, y0, s0), fma(h, y1, s1), fma(h, y2, s2)
            d = fma(y0, v0, fma(y1, v1, mul(y2, v2)))
            store(d_hidden, HIDDEN * k + half, where_positive(h, d))
        store(d_V_T, half, s0)
        store(d_V_T, HIDDEN + half, s1)
        store(d_V_T, 2 * HIDDEN + half, s2)
