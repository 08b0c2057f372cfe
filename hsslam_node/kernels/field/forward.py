"""Forward pass of the hybrid field on the CPU; stores what the backward pass needs.

Twin: `gpu_kernels/field/forward.py`. Reference: `reference/field.py`.
"""

import numpy as np

from hsslam_node.kernels.compiled import njit
from hsslam_node.kernels.field.decoder import HIDDEN, color_weights, geometry_weights
from hsslam_node.kernels.field.hash_grid import gather_hash
from hsslam_node.kernels.field.layout import BLOCK
from hsslam_node.kernels.field.one_blob import (
    add_one_blob,
    one_blob,
    one_blob_space,
    padded_blob_rows,
)
from hsslam_node.kernels.field.planes import gather_planes
from hsslam_node.kernels.simd import fma, load, mul, store, total
from hsslam_node.kernels.simd_pairs import copy_pair, transpose_pairs


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def field_forward(params, layout, points, n, acts):
    """SDF and colour at points[:n] ([N, 3] float32 m, world) into `acts`; outside: sdf 1, grey."""
    geometry_forward(params, layout, points, n, acts)
    for k in range(n):
        acts.color_row[k] = k
    color_forward(params, layout, n, n, acts)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def geometry_forward(params, layout, points, n, acts):
    """The SDF at points[:n] into `acts`, without colour."""
    L, C = layout.hash_offset.shape[0], layout.channels
    W1, blob_W1, W2 = geometry_weights(params, layout)
    blob, blob_rows = one_blob_space(), padded_blob_rows(blob_W1)
    relative_positions(layout, points[:n], acts.axes, acts.inside)
    gather_hash(params, layout, acts.axes, n, acts.hash_feature)
    for start in range(0, n, BLOCK):
        stop = min(start + BLOCK, n)
        geometry_in = acts.geometry_in[start:stop]
        join_hash_features(acts.hash_feature, start, geometry_in)
        for s in range(2):
            gather_planes(params, layout, s, acts.axes, start, geometry_in, 2 * L + s * C)
        hidden = acts.geometry_hidden[start:stop]
        np.dot(geometry_in, W1, hidden)
        one_blob(layout, acts.axes, start, stop - start, blob)
        add_one_blob(blob, blob_rows, hidden)
        out = acts.geometry_out[start:stop]
        np.dot(hidden, W2, out)
        inside, sdf = acts.inside[start:stop], acts.sdf[start:stop]
        for k in range(stop - start):
            sdf[k] = np.tanh(out[k, 0]) if inside[k] else np.float32(1.0)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def color_forward(params, layout, n, rows, acts):
    """Colour of the points acts.color_row[:rows] of the n of `geometry_forward`; others are grey."""
    C = layout.channels
    V1, blob_V1, V2 = color_weights(params, layout)
    V2 = V2.T.copy()
    blob, blob_rows = one_blob_space(), padded_blob_rows(blob_V1)
    acts.color_rows[0] = rows
    acts.rgb[:n] = np.float32(0.5)
    for start in range(0, rows, BLOCK):
        stop = min(start + BLOCK, rows)
        color_in, point = acts.color_in[start:stop], acts.color_row[start:stop]
        _take_points(acts.axes, acts.geometry_out, point, acts.color_axes, start, color_in)
        for s in range(2):
            gather_planes(params, layout, 2 + s, acts.color_axes, start, color_in, s * C)
        hidden = acts.color_hidden[start:stop]
        np.dot(color_in, V1, hidden)
        one_blob(layout, acts.color_axes, start, stop - start, blob)
        add_one_blob(blob, blob_rows, hidden)
        _decode_color(hidden, V2, point, acts.rgb)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def relative_positions(layout, points, axes, inside):
    """axes [3, N]: points [n, 3], clamped to the box, minus the origin; inside [N]."""
    n = points.shape[0]
    for k in range(n):
        inside[k] = 1
    for a in range(3):
        low, high, origin = layout.low[a], layout.high[a], layout.origin[a]
        axis = axes[a]
        for k in range(n):
            x = points[k, a]
            if not (x >= low and x <= high):
                inside[k] = 0
                x = low if not x > high else high
            axis[k] = x - origin


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def join_hash_features(feature, start, geometry_in):
    """Copy the features [L, N, 2] of points from `start` on into the first columns of [n, W]."""
    n, stride = geometry_in.shape
    L, N = feature.shape[0], feature.shape[1]
    tiled_n, tiled_L = n & ~7, L & ~7
    for k in range(0, tiled_n, 8):
        for level in range(0, tiled_L, 8):
            o, at = k * stride + 2 * level, 2 * (level * N + start + k)
            transpose_pairs(geometry_in, o, stride, feature, at, 2 * N)
    for k in range(n):
        for level in range(tiled_L if k < tiled_n else 0, L):
            copy_pair(geometry_in, k * stride + 2 * level, feature, 2 * (level * N + start + k))


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def split_hash_gradient(d_feature, start, d_in):
    """The reverse of `join_hash_features`, for gradients."""
    n, stride = d_in.shape
    L, N = d_feature.shape[0], d_feature.shape[1]
    tiled_n, tiled_L = n & ~7, L & ~7
    for k in range(0, tiled_n, 8):
        for level in range(0, tiled_L, 8):
            o, at = k * stride + 2 * level, 2 * (level * N + start + k)
            transpose_pairs(d_feature, at, 2 * N, d_in, o, stride)
    for k in range(n):
        for level in range(tiled_L if k < tiled_n else 0, L):
            copy_pair(d_feature, 2 * (level * N + start + k), d_in, k * stride + 2 * level)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _take_points(axes, geometry_out, point, color_axes, start, color_in):
    """Gather positions (from `start` on) and the last 16 columns of color_in [m, W] of points [m]."""
    stride = color_in.shape[1]
    for k in range(point.shape[0]):
        p = point[k]
        for a in range(3):
            color_axes[a, start + k] = axes[a, p]
        store(color_in, (k + 1) * stride - 16, load(geometry_out, 16 * p))


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _decode_color(hidden, V2, point, rgb):
    """Sigmoid of hidden [m, 32] times V2 [3, 32], into the rows `point` [m] of rgb."""
    one = np.float32(1.0)
    for k in range(point.shape[0]):
        low, high = load(hidden, HIDDEN * k), load(hidden, HIDDEN * k + 16)
        for c in range(3):
            logit = total(fma(low, load(V2, HIDDEN * c), mul(high, load(V2, HIDDEN * c + 16))))
            rgb[point[k], c] = one / (one + np.exp(-logit))
