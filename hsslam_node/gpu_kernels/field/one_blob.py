"""One-blob encoding on the GPU, 16 bins of an axis as one tile; a file of its own as its twin is.

Twin: `kernels/field/one_blob.py`.
"""

import triton
import triton.language as tl


@triton.jit
def one_blob(t):
    """Bins [B, 16] of t [B], the position along an axis in 0..1 (see reference/encodings.py)."""
    u = tl.arange(0, 16)[None, :].to(tl.float32) - 16.0 * t[:, None]
    return _cdf(u + 1.0) - _cdf(u)


@triton.jit
def one_blob_slope(t):
    """Derivative of `one_blob` by t, [B, 16]."""
    u = tl.arange(0, 16)[None, :].to(tl.float32) - 16.0 * t[:, None]
    return 16.0 * (_pdf(u) - _pdf(u + 1.0))


@triton.jit
def _cdf(u):
    """Distribution function of the quartic kernel on [-1, 1]."""
    u = tl.minimum(tl.maximum(u, -1.0), 1.0)
    u2 = u * u
    return 0.5 + 0.9375 * u * (1.0 + u2 * (0.2 * u2 - 0.6666667))


@triton.jit
def _pdf(u):
    d = tl.maximum(1.0 - u * u, 0.0)
    return 0.9375 * d * d
