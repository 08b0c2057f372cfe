"""SDF and its spatial gradient at any points, for the tracker and the mesher.

Twin: `gpu_kernels/field/sdf_query.py`. Reference: `reference/field.py`.
"""

import numpy as np

from hsslam_node.kernels.compiled import njit
from hsslam_node.kernels.copy_rows import copy_rows
from hsslam_node.kernels.field.decoder import HIDDEN, geometry_weights
from hsslam_node.kernels.field.forward import (
    join_hash_features,
    relative_positions,
    split_hash_gradient,
)
from hsslam_node.kernels.field.hash_grid import gather_hash, hash_position_gradient
from hsslam_node.kernels.field.layout import BLOCK
from hsslam_node.kernels.field.one_blob import (
    add_one_blob,
    one_blob,
    one_blob_position_gradient,
    one_blob_space,
    padded_blob_rows,
)
from hsslam_node.kernels.field.planes import gather_planes, plane_position_gradient
from hsslam_node.kernels.simd import (
    aligned_rows,
    fma,
    load,
    mul,
    spread,
    store,
    total,
    where_positive,
)

_CHUNK = 8 * BLOCK  # points whose hash features are gathered level by level


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def query_sdf(params, layout, points, sdf, inside, gradient, want_gradient):
    """SDF [N] in units of T at points [N, 3] (m, world) and, if wanted, gradient [N, 3] (T/m).

    Reads the geometry prefix of `params` only. Outside the bound: sdf 1, inside 0, gradient 0.
    """
    L, C = layout.hash_offset.shape[0], layout.channels
    W1, blob_W1, W2 = geometry_weights(params, layout)
    W1_T = aligned_rows(HIDDEN, 2 * L + 2 * C)
    copy_rows(W1.T, W1_T)
    w2 = W2[:, 0].copy()
    n = points.shape[0]
    chunk = min(n, _CHUNK)
    axes = aligned_rows(3, chunk)
    feature = np.empty((L, chunk, 2), np.float32)
    x, d_x = aligned_rows(BLOCK, 2 * L + 2 * C), aligned_rows(BLOCK, 2 * L + 2 * C)
    hidden, d_hidden = aligned_rows(BLOCK, HIDDEN), aligned_rows(BLOCK, HIDDEN)
    blob, blob_rows = one_blob_space(), padded_blob_rows(blob_W1)
    for first in range(0, n, chunk):
        size = min(n - first, chunk)
        relative_positions(layout, points[first : first + size], axes, inside[first : first + size])
        gather_hash(params, layout, axes, size, feature)
        for start in range(0, size, BLOCK):
            m = min(size - start, BLOCK)
            join_hash_features(feature, start, x[:m])
            for s in range(2):
                gather_planes(params, layout, s, axes, start, x[:m], 2 * L + s * C)
            np.dot(x[:m], W1, hidden[:m])
            one_blob(layout, axes, start, m, blob)
            add_one_blob(blob, blob_rows, hidden[:m])
            at = first + start
            _decode(hidden[:m], w2, inside[at : at + m], sdf[at : at + m], d_hidden)
            if want_gradient:
                np.dot(d_hidden[:m], W1_T, d_x[:m])
                d_position = gradient[at : at + m]
                d_position[:] = np.float32(0.0)
                split_hash_gradient(feature, start, d_x[:m])
                for s in range(2):
                    plane_position_gradient(
                        params, layout, s, axes, start, d_x[:m], 2 * L + s * C, d_position
                    )
                one_blob_position_gradient(blob, blob_rows, d_hidden[:m], d_position)
        if want_gradient:
            hash_position_gradient(
                params, layout, axes, size, feature, gradient[first : first + size]
            )


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _decode(hidden, w2, inside, sdf, d_hidden):
    """SDF of hidden activations [m, 32] and its derivative by their values before the ReLU."""
    w_low, w_high = load(w2, 0), load(w2, 16)
    for k in range(hidden.shape[0]):
        low, high = load(hidden, HIDDEN * k), load(hidden, HIDDEN * k + 16)
        s = np.tanh(total(fma(low, w_low, mul(high, w_high))))
        slope = np.float32(1.0) - s * s
        if inside[k] == 0:
            s, slope = np.float32(1.0), np.float32(0.0)
        sdf[k] = s
        store(d_hidden, HIDDEN * k, where_positive(low, mul(spread(slope), w_low)))
        store(d_hidden, HIDDEN * k + 16, where_positive(high, mul(spread(slope), w_high)))
