"""Adam that steps only what the iteration touched."""

import numpy as np
from numba import njit

from hsslam_node.kernels.touched import PAGE


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
):
    """One step over the touched 16-float chunks, in memory order, clearing their gradient.

    Lazy semantics (those of torch.optim.SparseAdam): a chunk without gradient is not moved and its
    moments do not decay; the bias correction uses the global `step` (from 1). `rates` [K, 3] are
    regions (first float, last float + 1, learning rate), multiples of 16. `stepped_at` [P / 16] int32
    becomes `step` for the chunks that moved, which copies of the parameters lack then, and so does
    `page_stepped_at` for pages of 64 chunks. Only pages with a mark are looked at: the cost grows with
    what was touched, not with the map.
    """
    correction1 = 1.0 - beta1**step
    correction2 = np.float32(1.0 / np.sqrt(1.0 - beta2**step))
    b1, b2, e = np.float32(beta1), np.float32(beta2), np.float32(eps)
    one = np.float32(1.0)
    for r in range(rates.shape[0]):
        rate = np.float32(rates[r, 2] / correction1)
        first_chunk, last_chunk = int(rates[r, 0]) >> 4, int(rates[r, 1]) >> 4
        for page in range(first_chunk // PAGE, (last_chunk + PAGE - 1) // PAGE):
            if grad.pages[page] == 0:
                continue
            for chunk in range(max(page * PAGE, first_chunk), min((page + 1) * PAGE, last_chunk)):
                if grad.touched[chunk] == 0:
                    continue
                first = chunk << 4
                g = grad.values[first : first + 16]
                p, v = params[first : first + 16], second_moment[first : first + 16]
                m = first_moment[first : first + 16]
                for k in range(16):
                    m_k = b1 * m[k] + (one - b1) * g[k]
                    v_k = b2 * v[k] + (one - b2) * g[k] * g[k]
                    m[k] = m_k
                    v[k] = v_k
                    p[k] -= rate * m_k / (np.sqrt(v_k) * correction2 + e)
                    g[k] = np.float32(0.0)
                grad.touched[chunk] = 0
                stepped_at[chunk] = step
                page_stepped_at[page] = step
    _forget_clean_pages(grad)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _forget_clean_pages(grad):
    """Unmark pages without a touched chunk: all but those in regions that no rate was given for."""
    for page in range(grad.pages.shape[0]):
        if grad.pages[page]:
            left = np.uint8(0)
            for chunk in range(page * PAGE, (page + 1) * PAGE):
                left |= grad.touched[chunk]
            grad.pages[page] = left
