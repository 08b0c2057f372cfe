"""Forward pass of the hybrid field on the CPU, keeping what the backward pass needs."""

from typing import NamedTuple

import numpy as np
from numba import njit

from hsslam_node.kernels.hash_grid import gather_hash
from hsslam_node.kernels.kernel_layout import KernelLayout
from hsslam_node.kernels.one_blob import BINS, one_blob_bins
from hsslam_node.kernels.planes import gather_planes

HIDDEN = 32
BLOCK = 256  # points per matrix product: activations of a block stay in the L2 cache


class FieldActivations(NamedTuple):
    """Work space for up to N points; C channels, L hash levels."""

    position: np.ndarray  # [N, 3] m, relative to the low corner
    inside: np.ndarray  # [N] uint8, 1 where the point is in the bound
    geometry_in: np.ndarray  # [N, 2 L + 2 C]
    geometry_hidden: np.ndarray  # [N, 32], after ReLU
    geometry_out: np.ndarray  # [N, 16], column 0 before tanh
    color_in: np.ndarray  # [N, 2 C + 16], the last 16 are geometry_out (column 0 has zero weight)
    color_hidden: np.ndarray  # [N, 32], after ReLU
    sdf: np.ndarray  # [N] in units of the truncation
    rgb: np.ndarray  # [N, 3]


def field_activations(layout: KernelLayout, point_count: int) -> FieldActivations:
    """Allocate work space for `point_count` points."""
    width = 2 * len(layout.hash_offset) + 2 * layout.channels

    def zeros(*shape: int) -> np.ndarray:
        return np.zeros((point_count, *shape), np.float32)

    return FieldActivations(
        position=zeros(3),
        inside=np.zeros(point_count, np.uint8),
        geometry_in=zeros(width),
        geometry_hidden=zeros(HIDDEN),
        geometry_out=zeros(16),
        color_in=zeros(2 * layout.channels + 16),
        color_hidden=zeros(HIDDEN),
        sdf=zeros(),
        rgb=zeros(3),
    )


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def field_forward(params, layout, points, n, acts):
    """SDF and colour at points[:n] ([N, 3] float32 m, world) into `acts`; outside: sdf 1, grey."""
    L2 = 2 * layout.hash_offset.shape[0]
    C = layout.channels
    width = L2 + 2 * C
    rows = width + layout.blob_rows
    W1 = params[layout.geometry_W1 : layout.geometry_W1 + rows * HIDDEN].reshape(rows, HIDDEN)
    W2 = params[layout.geometry_W2 : layout.geometry_W2 + HIDDEN * 16].reshape(HIDDEN, 16)
    V1, blob_V1 = color_first_layer(params, layout)
    V2 = params[layout.color_W2 : layout.color_W2 + HIDDEN * 3].reshape(HIDDEN, 3)
    for start in range(0, n, BLOCK):
        stop = min(start + BLOCK, n)
        position = acts.position[start:stop]
        geometry_in, color_in = acts.geometry_in[start:stop], acts.color_in[start:stop]
        for k in range(start, stop):
            acts.inside[k] = relative_position(layout, points[k], acts.position[k])
        gather_hash(params, layout, position, geometry_in)
        for s in range(2):
            gather_planes(params, layout, s, position, geometry_in, L2 + s * C)
            gather_planes(params, layout, 2 + s, position, color_in, s * C)
        hidden = acts.geometry_hidden[start:stop]
        np.dot(geometry_in, W1[:width], hidden)
        add_one_blob(layout, position, W1[width:], hidden)
        relu(hidden)
        np.dot(hidden, W2, acts.geometry_out[start:stop])
        for k in range(start, stop):
            for c in range(16):
                acts.color_in[k, 2 * C + c] = acts.geometry_out[k, c]
            acts.sdf[k] = np.tanh(acts.geometry_out[k, 0]) if acts.inside[k] else np.float32(1.0)
        hidden = acts.color_hidden[start:stop]
        np.dot(color_in, V1, hidden)
        add_one_blob(layout, position, blob_V1, hidden)
        relu(hidden)
        np.dot(hidden, V2, acts.rgb[start:stop])
        for k in range(start, stop):
            for c in range(3):
                acts.rgb[k, c] = np.float32(1.0) / (np.float32(1.0) + np.exp(-acts.rgb[k, c]))


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def color_first_layer(params, layout):
    """First colour layer for `color_in` ([2 C + 16, 32], row 2 C zero); one-blob rows [48 or 0, 32]."""
    C2 = 2 * layout.channels
    blobs = layout.blob_rows
    rows = C2 + blobs + 15
    V = params[layout.color_W1 : layout.color_W1 + rows * HIDDEN].reshape(rows, HIDDEN)
    dense = np.zeros((C2 + 16, HIDDEN), np.float32)
    dense[:C2] = V[:C2]
    dense[C2 + 1 :] = V[C2 + blobs :]
    return dense, V[C2 : C2 + blobs]


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def relative_position(layout, point, p):
    """p = point - low, clamped to the box; returns whether the point was inside."""
    inside = 1
    for a in range(3):
        x = point[a]
        if not (x >= layout.low[a] and x <= layout.high[a]):
            inside = 0
            x = layout.low[a] if not x > layout.high[a] else layout.high[a]
        p[a] = x - layout.low[a]
    return inside


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def add_one_blob(layout, position, rows, hidden):
    """hidden [n, 32] += one-blob encoding of position [n, 3] times its rows [48 or 0, 32]."""
    if rows.shape[0] == 0:
        return
    weight = np.empty(3, np.float32)
    slope = np.empty(3, np.float32)
    for k in range(position.shape[0]):
        h = hidden[k]
        for a in range(3):
            j = one_blob_bins(position[k, a] * layout.inv_extent[a], weight, slope)
            # bins beyond the ends have no row: they are replaced by the end's, with weight 0
            w0 = weight[0] if j > 0 else np.float32(0.0)
            w1 = weight[1]
            w2 = weight[2] if j < BINS - 1 else np.float32(0.0)
            r0 = rows[a * BINS + max(j - 1, 0)]
            r1 = rows[a * BINS + j]
            r2 = rows[a * BINS + min(j + 1, BINS - 1)]
            for c in range(HIDDEN):
                h[c] += w0 * r0[c] + w1 * r1[c] + w2 * r2[c]


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def relu(x):
    """max(x, 0) in place."""
    flat = x.reshape(x.size)
    for k in range(flat.size):
        flat[k] = max(flat[k], np.float32(0.0))
