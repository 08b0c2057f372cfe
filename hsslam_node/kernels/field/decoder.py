"""The decoders' weight matrices as the kernels multiply with them.

Twin: `gpu_kernels/field/decoder.py`. Reference: `reference/field.py`.
"""

import numpy as np

from hsslam_node.kernels.compiled import njit
from hsslam_node.kernels.copy_rows import copy_rows

HIDDEN = 32


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def geometry_weights(values, layout):
    """Views of the first layer [2 L + 2 C, 32], its one-blob rows [48, 32] (or none), the second [32, 16]."""
    width = 2 * layout.hash_offset.shape[0] + 2 * layout.channels
    rows = width + layout.blob_rows
    W1 = values[layout.geometry_W1 : layout.geometry_W1 + rows * HIDDEN].reshape(rows, HIDDEN)
    W2 = values[layout.geometry_W2 : layout.geometry_W2 + HIDDEN * 16].reshape(HIDDEN, 16)
    return W1[:width], W1[width:], W2


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def color_weights(values, layout):
    """First layer for `color_in` (a copy [2 C + 16, 32], row 2 C zero), its one-blob rows [48, 32] and
    the second layer [32, 3] (views)."""
    C2 = 2 * layout.channels
    V1, blob_V1, feature_V1 = color_first_layer(values, layout)
    dense = np.zeros((C2 + 16, HIDDEN), np.float32)
    copy_rows(V1, dense[:C2])
    copy_rows(feature_V1, dense[C2 + 1 :])
    V2 = values[layout.color_W2 : layout.color_W2 + HIDDEN * 3].reshape(HIDDEN, 3)
    return dense, blob_V1, V2


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def color_first_layer(values, layout):
    """Views of its rows for planes [2 C, 32], one-blob [48, 32] and geometry feature [15, 32]."""
    C2 = 2 * layout.channels
    last = C2 + layout.blob_rows
    rows = last + 15
    V = values[layout.color_W1 : layout.color_W1 + rows * HIDDEN].reshape(rows, HIDDEN)
    return V[:C2], V[C2:last], V[last:]
