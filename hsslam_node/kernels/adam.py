"""Adam that steps only what the iteration touched."""

import numpy as np
from numba import njit


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def sparse_adam(
    params, first_moment, second_moment, grad, step, rates, eps, beta1, beta2, stepped_at
):  # fmt: skip
    """One step over the touched 16-float chunks, in memory order, clearing their gradient.

    Lazy semantics (those of torch.optim.SparseAdam): a chunk without gradient is not moved and its
    moments do not decay; the bias correction uses the global `step` (from 1). `rates` [K, 3] are
    regions (first float, last float + 1, learning rate), multiples of 16. `stepped_at`
    [P / 16] int32 becomes `step` for the chunks that moved, which copies of the parameters lack then.
    """
    correction1 = 1.0 - beta1**step
    correction2 = np.float32(1.0 / np.sqrt(1.0 - beta2**step))
    b1 = np.float32(beta1)
    b2 = np.float32(beta2)
    one = np.float32(1.0)
    e = np.float32(eps)
    g = grad.values
    words = grad.touched.view(np.uint64)
    for r in range(rates.shape[0]):
        rate = np.float32(rates[r, 2] / correction1)
        first_chunk = int(rates[r, 0]) >> 4
        last_chunk = int(rates[r, 1]) >> 4
        for word in range(first_chunk >> 3, (last_chunk + 7) >> 3):
            if words[word] == 0:
                continue
            for chunk in range(max(word << 3, first_chunk), min((word << 3) + 8, last_chunk)):
                if grad.touched[chunk] == 0:
                    continue
                first = chunk << 4
                for k in range(first, first + 16):
                    m = b1 * first_moment[k] + (one - b1) * g[k]
                    v = b2 * second_moment[k] + (one - b2) * g[k] * g[k]
                    first_moment[k] = m
                    second_moment[k] = v
                    params[k] -= rate * m / (np.sqrt(v) * correction2 + e)
                    g[k] = np.float32(0.0)
                grad.touched[chunk] = 0
                stepped_at[chunk] = step
