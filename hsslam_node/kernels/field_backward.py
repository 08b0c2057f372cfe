"""Backward pass of the hybrid field on the CPU: to the parameters, and to the sample positions."""

from typing import NamedTuple

import numpy as np
from numba import njit

from hsslam_node.kernels.field_forward import BLOCK, HIDDEN, color_first_layer
from hsslam_node.kernels.hash_grid import hash_position_gradient, scatter_hash
from hsslam_node.kernels.kernel_layout import KernelLayout
from hsslam_node.kernels.one_blob import BINS, one_blob_bins
from hsslam_node.kernels.planes import plane_position_gradient, scatter_planes


class Gradient(NamedTuple):
    """Dense gradient that remembers which 16-float chunks were written, for a sparse optimiser."""

    values: np.ndarray  # [P] float32, zero outside the touched chunks
    touched: np.ndarray  # [ceil(P / 128) * 8] uint8, one a chunk, padded to whole 8-byte words


def gradient(layout: KernelLayout) -> Gradient:
    """An empty gradient for all parameters."""
    words = -(-layout.parameter_count // 128)
    return Gradient(np.zeros(layout.parameter_count, np.float32), np.zeros(8 * words, np.uint8))


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def field_backward(params, layout, n, acts, d_sdf, d_rgb, grad, d_points, want_points):
    """Add the parameter gradient to `grad`; where asked, write d_points [N, 3] (1/m).

    `acts` as `field_forward` left it for the first n points; d_sdf [N], d_rgb [N, 3] are the loss
    gradients. Points outside the bound contribute nothing.
    """
    L2 = 2 * layout.hash_offset.shape[0]
    C = layout.channels
    width = L2 + 2 * C
    g = grad.values
    blobs = layout.blob_rows
    rows = width + blobs
    W1 = params[layout.geometry_W1 : layout.geometry_W1 + rows * HIDDEN].reshape(rows, HIDDEN)
    W2 = params[layout.geometry_W2 : layout.geometry_W2 + HIDDEN * 16].reshape(HIDDEN, 16)
    V1, blob_V1 = color_first_layer(params, layout)
    V2 = params[layout.color_W2 : layout.color_W2 + HIDDEN * 3].reshape(HIDDEN, 3)
    W1_T = W1[:width].T.copy()
    W2_T = W2.T.copy()
    V1_T = V1.T.copy()
    V2_T = V2.T.copy()

    dW1 = g[layout.geometry_W1 : layout.geometry_W1 + rows * HIDDEN].reshape(rows, HIDDEN)
    dW2 = g[layout.geometry_W2 : layout.geometry_W2 + HIDDEN * 16].reshape(HIDDEN, 16)
    c_rows = 2 * C + blobs + 15
    dV = g[layout.color_W1 : layout.color_W1 + c_rows * HIDDEN].reshape(c_rows, HIDDEN)
    dV2 = g[layout.color_W2 : layout.color_W2 + HIDDEN * 3].reshape(HIDDEN, 3)

    d_logit = np.empty((BLOCK, 3), np.float32)
    d_color_hidden = np.empty((BLOCK, HIDDEN), np.float32)
    d_color_in = np.empty((BLOCK, 2 * C + 16), np.float32)
    d_out = np.empty((BLOCK, 16), np.float32)
    d_hidden = np.empty((BLOCK, HIDDEN), np.float32)
    d_in = np.empty((BLOCK, width), np.float32)
    product_W1 = np.empty((width, HIDDEN), np.float32)
    product_V1 = np.empty((2 * C + 16, HIDDEN), np.float32)
    product_W2 = np.empty((HIDDEN, 16), np.float32)
    product_V2 = np.empty((HIDDEN, 3), np.float32)

    for start in range(0, n, BLOCK):
        stop = min(start + BLOCK, n)
        m = stop - start
        for k in range(m):
            live = np.float32(acts.inside[start + k])
            for c in range(3):
                v = acts.rgb[start + k, c]
                d_logit[k, c] = live * d_rgb[start + k, c] * v * (np.float32(1.0) - v)
        _layer_backward(
            acts.color_hidden[start:stop], d_logit[:m], V2_T, product_V2, dV2, d_color_hidden[:m]
        )
        _mask_relu(acts.color_hidden[start:stop], d_color_hidden[:m])
        np.dot(d_color_hidden[:m], V1_T, d_color_in[:m])
        np.dot(acts.color_in[start:stop].T, d_color_hidden[:m], product_V1)
        dV[: 2 * C] += product_V1[: 2 * C]
        dV[2 * C + blobs :] += product_V1[2 * C + 1 :]
        _scatter_one_blob(
            layout, acts.position[start:stop], d_color_hidden[:m], dV[2 * C : 2 * C + blobs]
        )
        for k in range(m):
            for c in range(1, 16):
                d_out[k, c] = d_color_in[k, 2 * C + c]
            s = acts.sdf[start + k]
            live = np.float32(acts.inside[start + k])
            d_out[k, 0] = live * d_sdf[start + k] * (np.float32(1.0) - s * s)
        _layer_backward(
            acts.geometry_hidden[start:stop], d_out[:m], W2_T, product_W2, dW2, d_hidden[:m]
        )
        _mask_relu(acts.geometry_hidden[start:stop], d_hidden[:m])
        _layer_backward(
            acts.geometry_in[start:stop], d_hidden[:m], W1_T, product_W1, dW1[:width], d_in[:m]
        )
        _scatter_one_blob(layout, acts.position[start:stop], d_hidden[:m], dW1[width:])
        position = acts.position[start:stop]
        scatter_hash(g, grad.touched, layout, position, d_in[:m])
        for s in range(2):
            scatter_planes(g, grad.touched, layout, s, position, d_in[:m], L2 + s * C)
            scatter_planes(g, grad.touched, layout, 2 + s, position, d_color_in[:m], s * C)
        if want_points:
            d_position = d_points[start:stop]
            d_position[:] = np.float32(0.0)
            hash_position_gradient(params, layout, position, d_in[:m], d_position)
            for s in range(2):
                plane_position_gradient(
                    params, layout, s, position, d_in[:m], L2 + s * C, d_position
                )
                plane_position_gradient(
                    params, layout, 2 + s, position, d_color_in[:m], s * C, d_position
                )
            one_blob_position_gradient(layout, position, W1[width:], d_hidden[:m], d_position)
            one_blob_position_gradient(layout, position, blob_V1, d_color_hidden[:m], d_position)
    first = layout.geometry_W1 >> 4
    last = (layout.color_W2 + HIDDEN * 3 - 1) >> 4
    grad.touched[first : last + 1] = 1


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def one_blob_position_gradient(layout, position, rows, d_hidden, d_position):
    """Add the derivative by position [n, 3] of the one-blob contribution to a hidden layer [n, 32]."""
    if rows.shape[0] == 0:
        return
    weight = np.empty(3, np.float32)
    slope = np.empty(3, np.float32)
    for k in range(position.shape[0]):
        d = d_hidden[k]
        for a in range(3):
            j = one_blob_bins(position[k, a] * layout.inv_extent[a], weight, slope)
            s0 = slope[0] if j > 0 else np.float32(0.0)
            s1 = slope[1]
            s2 = slope[2] if j < BINS - 1 else np.float32(0.0)
            r0 = rows[a * BINS + max(j - 1, 0)]
            r1 = rows[a * BINS + j]
            r2 = rows[a * BINS + min(j + 1, BINS - 1)]
            total = np.float32(0.0)
            for c in range(HIDDEN):
                total += d[c] * (s0 * r0[c] + s1 * r1[c] + s2 * r2[c])
            d_position[k, a] += total * layout.inv_extent[a]


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _layer_backward(x, d_y, W_T, product, dW, d_x):
    """Linear layer y = x W: dW += x^T d_y, d_x = d_y W^T."""
    np.dot(x.T, d_y, product)
    dW += product
    np.dot(d_y, W_T, d_x)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _mask_relu(hidden, d_hidden):
    for k in range(hidden.shape[0]):
        for c in range(HIDDEN):
            if hidden[k, c] <= np.float32(0.0):
                d_hidden[k, c] = np.float32(0.0)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _scatter_one_blob(layout, position, d_hidden, d_rows):
    if d_rows.shape[0] == 0:
        return
    weight = np.empty(3, np.float32)
    slope = np.empty(3, np.float32)
    for k in range(position.shape[0]):
        for a in range(3):
            j = one_blob_bins(position[k, a] * layout.inv_extent[a], weight, slope)
            for m in range(3):
                b = j - 1 + m
                if 0 <= b < BINS:
                    w = weight[m]
                    row = d_rows[a * BINS + b]
                    for c in range(HIDDEN):
                        row[c] += w * d_hidden[k, c]
