"""One-blob encoding on the CPU: at most three bins per axis are not zero, so it is never written out.

Twin: `gpu_kernels/field/one_blob.py`. Reference: `reference/encodings.py`.

A first layer needs only the sum of three weight rows per axis. All functions take positions as
axes [3, N] (m, from the low corner of the first bound) and weight rows [54, 32] with a row of zeros
before and after the 16 bins of x, of y and of z, so that the border is no special case
(`padded_blob_rows`). No rows: no encoding.
"""

from typing import NamedTuple

import numpy as np

from hsslam_node.kernels.compiled import njit
from hsslam_node.kernels.copy_rows import copy_rows
from hsslam_node.kernels.field.layout import BLOCK
from hsslam_node.kernels.simd import add, fma, load, mul, spread, store, total, where_positive

BINS = 16
_PADDED = BINS + 2
_HIDDEN = 32


class OneBlob(NamedTuple):
    """Encodings of up to 256 points: per axis three successive bins; all others are zero."""

    first: np.ndarray  # [3 * 256] int32, padded row of the first of the three: 18 axis + bin + 1
    weight: np.ndarray  # [9 * 256], bins of x, y, z
    slope: np.ndarray  # [9 * 256] 1/m, their derivative by position


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def one_blob_space():
    """Work space."""
    return OneBlob(
        np.empty(3 * BLOCK, np.int32),
        np.empty(9 * BLOCK, np.float32),
        np.empty(9 * BLOCK, np.float32),
    )


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def padded_blob_rows(rows):
    """Weight rows [48, 32], or [0, 32], with a row of zeros before and after each axis."""
    axes = rows.shape[0] // BINS
    padded = np.zeros((axes * _PADDED, _HIDDEN), np.float32)
    for a in range(axes):
        own = padded[_PADDED * a + 1 : _PADDED * a + 1 + BINS]
        copy_rows(rows[BINS * a : BINS * (a + 1)], own)
    return padded


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def add_blob_gradient(d_padded, d_rows):
    """Add the gradient by the padded rows to that by the rows [48, 32]."""
    for a in range(d_rows.shape[0] // BINS):
        for k in range(BINS):
            for i in range(_HIDDEN):
                d_rows[BINS * a + k, i] += d_padded[_PADDED * a + 1 + k, i]


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def one_blob(layout, axes, start, n, blob):
    """Encode n <= 256 positions from `start` on. Quartic kernel of radius 1/16 (paper III-A, one-blob)."""
    one, zero, bins = np.float32(1.0), np.float32(0.0), np.float32(BINS)
    for a in range(3):
        scale = layout.inv_extent[a] * bins
        row = np.int32(_PADDED * a)
        position = axes[a, start : start + n]
        first, at = blob.first[BLOCK * a : BLOCK * a + n], 3 * a * BLOCK
        w0, s0 = blob.weight[at : at + n], blob.slope[at : at + n]
        w1, s1 = blob.weight[at + BLOCK :][:n], blob.slope[at + BLOCK :][:n]
        w2, s2 = blob.weight[at + 2 * BLOCK :][:n], blob.slope[at + 2 * BLOCK :][:n]
        for k in range(n):
            unclamped = position[k] * scale  # beyond the first bound the value at its border
            scaled = min(max(unclamped, zero), bins)
            slope = scale if scaled == unclamped else zero
            j = min(np.int32(scaled), np.int32(BINS - 1))
            f = scaled - np.float32(j)
            left, right = _cdf(-f), _cdf(one - f)
            d_left, d_right = -_pdf(-f) * slope, -_pdf(one - f) * slope
            w0[k] = left
            w1[k] = right - left
            w2[k] = one - right
            s0[k] = d_left
            s1[k] = d_right - d_left
            s2[k] = -d_right
            first[k] = row + j


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def add_one_blob(blob, rows, hidden):
    """hidden [n, 32] becomes the ReLU of itself plus the encoding times its weight rows [54, 32]."""
    axes = rows.shape[0] // _PADDED
    for k in range(hidden.shape[0]):
        low, high = load(hidden, _HIDDEN * k), load(hidden, _HIDDEN * k + 16)
        for a in range(axes):
            row = _HIDDEN * blob.first[BLOCK * a + k]
            for b in range(3):
                w = spread(blob.weight[(3 * a + b) * BLOCK + k])
                low = fma(w, load(rows, row + _HIDDEN * b), low)
                high = fma(w, load(rows, row + _HIDDEN * b + 16), high)
        store(hidden, _HIDDEN * k, where_positive(low, low))
        store(hidden, _HIDDEN * k + 16, where_positive(high, high))


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def scatter_one_blob(blob, d_hidden, d_rows):
    """Add the gradient by the weight rows [54, 32], from d_hidden [n, 32] before the ReLU.

    Successive points with the same bins, as samples of a ray often have, are added up first.
    """
    n = d_hidden.shape[0]
    zero = spread(np.float32(0.0))
    for a in range(d_rows.shape[0] // _PADDED):
        first, at = blob.first[BLOCK * a :], 3 * a * BLOCK
        w0, w1 = blob.weight[at:], blob.weight[at + BLOCK :]
        w2 = blob.weight[at + 2 * BLOCK :]
        for half in range(0, _HIDDEN, 16):
            k = 0
            while k < n:
                row = first[k]
                d0 = d1 = d2 = zero
                while k < n and first[k] == row:
                    d = load(d_hidden, _HIDDEN * k + half)
                    d0 = fma(spread(w0[k]), d, d0)
                    d1 = fma(spread(w1[k]), d, d1)
                    d2 = fma(spread(w2[k]), d, d2)
                    k += 1
                o = _HIDDEN * row + half
                store(d_rows, o, add(d0, load(d_rows, o)))
                store(d_rows, o + _HIDDEN, add(d1, load(d_rows, o + _HIDDEN)))
                store(d_rows, o + 2 * _HIDDEN, add(d2, load(d_rows, o + 2 * _HIDDEN)))


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def one_blob_position_gradient(blob, rows, d_hidden, d_position):
    """Add the gradient by position, from d_hidden [n, 32] through the encoding, to d_position [n, 3]."""
    axes = rows.shape[0] // _PADDED
    for k in range(d_hidden.shape[0]):
        low, high = load(d_hidden, _HIDDEN * k), load(d_hidden, _HIDDEN * k + 16)
        for a in range(axes):
            row = _HIDDEN * blob.first[BLOCK * a + k]
            along = spread(np.float32(0.0))
            for b in range(3):
                r = mul(low, load(rows, row + _HIDDEN * b))
                r = fma(high, load(rows, row + _HIDDEN * b + 16), r)
                along = fma(spread(blob.slope[(3 * a + b) * BLOCK + k]), r, along)
            d_position[k, a] += total(along)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _cdf(u):
    """Distribution function of the quartic kernel on [-1, 1]."""
    u2 = u * u
    return np.float32(0.9375) * u * (
        (np.float32(0.2) * u2 - np.float32(2.0 / 3.0)) * u2 + np.float32(1.0)
    ) + np.float32(0.5)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _pdf(u):
    d = np.float32(1.0) - u * u
    return np.float32(0.9375) * d * d
