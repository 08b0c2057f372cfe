"""One-blob encoding on the CPU: at most three bins per axis are not zero, so it is never written out."""

import numpy as np
from numba import njit

BINS = 16


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def one_blob_bins(t, weight, slope):
    """The three bins around `t` (position in 0..1): returns the middle bin, fills weights and slopes.

    Bin j - 1 + k has value weight[k] and derivative slope[k] with respect to `t`, k = 0, 1, 2; bins
    outside 0..15 are dropped by the caller. Quartic kernel of radius 1/16 (paper III-A, one-blob).
    """
    scaled = t * np.float32(BINS)
    j = int(scaled)
    if j > BINS - 1:
        j = BINS - 1
    if j < 0:
        j = 0
    f = scaled - np.float32(j)
    left = _cdf(-f)
    right = _cdf(np.float32(1.0) - f)
    weight[0] = left
    weight[1] = right - left
    weight[2] = np.float32(1.0) - right
    d_left = -_pdf(-f) * np.float32(BINS)
    d_right = -_pdf(np.float32(1.0) - f) * np.float32(BINS)
    slope[0] = d_left
    slope[1] = d_right - d_left
    slope[2] = -d_right
    return j


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
