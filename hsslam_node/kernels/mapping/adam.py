"""Adam that steps only the chunks that the iteration touched.

Twin: `gpu_kernels/mapping/adam.py`. Tests compare it with `torch.optim.Adam`.
"""

import numpy as np

from hsslam_node.kernels.compiled import njit
from hsslam_node.kernels.field.gradient import STRIPE
from hsslam_node.kernels.simd import (
    any_not_zero,
    div,
    fma,
    load,
    lowest_bit,
    mul,
    root,
    spread,
    store,
    sub,
)
from hsslam_node.map.parameter_arrays import PAGE


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def sparse_adam(
    params,
    first_moment,
    second_moment,
    grad,
    step,
    rates,
    eps,
    beta1,
    beta2,
    stepped_at,
    page_stepped_at,
    worker,
    workers,
):
    """One step over the touched 16-float chunks, in memory order; it clears their gradient.

    Lazy semantics (those of torch.optim.SparseAdam): a chunk without gradient does not move and its moments
    do not decay; the bias correction uses the global `step` (from 1). `rates` [K, 3] are
    regions (first float, last float + 1, learning rate), multiples of 16. `stepped_at` [P / 16] int32
    becomes `step` for the chunks that moved, and `page_stepped_at` for their pages of 64 chunks, so that
    copies of the parameters can fetch them. Chunks in no region keep mark and gradient. `workers` may step
    in parallel, each in its own stripes of pages.
    """
    correction1 = 1.0 - beta1**step
    correction2 = spread(np.float32(1.0 / np.sqrt(1.0 - beta2**step)))
    keep1, add1 = spread(np.float32(beta1)), spread(np.float32(1.0 - beta1))
    keep2, add2 = spread(np.float32(beta2)), spread(np.float32(1.0 - beta2))
    least, zero = spread(np.float32(eps)), spread(np.float32(0.0))
    for r in range(rates.shape[0]):
        rate = spread(np.float32(rates[r, 2] / correction1))
        first_chunk, last_chunk = int(rates[r, 0]) >> 4, int(rates[r, 1]) >> 4
        for page in range(first_chunk // PAGE, (last_chunk + PAGE - 1) // PAGE):
            if page // STRIPE % workers != worker:
                continue
            left = _take_touched(grad, page, first_chunk, last_chunk)
            if left != 0:
                page_stepped_at[page] = step
            while left != 0:
                chunk = page * PAGE + lowest_bit(left)
                left &= left - np.uint64(1)
                o = chunk << 4
                g = load(grad.values, o)
                m = fma(add1, g, mul(keep1, load(first_moment, o)))
                v = fma(add2, mul(g, g), mul(keep2, load(second_moment, o)))
                change = div(mul(rate, m), fma(root(v), correction2, least))
                store(first_moment, o, m)
                store(second_moment, o, v)
                store(params, o, sub(load(params, o), change))
                store(grad.values, o, zero)
                stepped_at[chunk] = step


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _take_touched(grad, page, first_chunk, last_chunk):
    """Bits of the touched chunks of a page, from first_chunk to last_chunk - 1; clears their marks."""
    start, stop = max(page * PAGE, first_chunk), min((page + 1) * PAGE, last_chunk)
    whole = np.uint64(0xFFFFFFFFFFFFFFFF)
    asked = whole << np.uint64(start & 63) & whole >> np.uint64((64 - stop) & 63)
    found = grad.touched[page] & asked
    grad.touched[page] ^= found
    for chunk in range(max(start, grad.unmarked[0]), min(stop, grad.unmarked[1])):
        found |= np.uint64(any_not_zero(grad.values, chunk << 4)) << np.uint64(chunk & 63)
    return found
