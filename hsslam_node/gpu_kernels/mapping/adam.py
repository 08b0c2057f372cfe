"""Adam on the GPU; it steps only the chunks that the iteration touched.

Twin: `kernels/mapping/adam.py`.
"""

import triton
import triton.language as tl
from torch import Tensor

from hsslam_node.gpu_kernels.block_size import block_size
from hsslam_node.gpu_kernels.field.activations import Gradient

BLOCK = 64  # chunks of one program


def sparse_adam(
    params: Tensor,
    first_moment: Tensor,
    second_moment: Tensor,
    grad: Gradient,
    step: Tensor,
    rates: Tensor,
    eps: float,
    beta1: float,
    beta2: float,
    stepped_at: Tensor,
) -> None:
    """One step over the touched 16-float chunks; it clears their gradient and their mark.

    Lazy semantics as in kernels/mapping/adam.py: a chunk without gradient does not move and its moments do
    not decay; the bias correction uses the global `step` [1] int32 (from 1). `rates` [K, 3] float64 are
    regions (first float, last float + 1, learning rate), multiples of 16, that do not overlap; chunks in no
    region keep their gradient. `stepped_at` [P / 16] int32 becomes `step` for the chunks that moved.
    """
    chunks = stepped_at.shape[0]
    B = block_size(BLOCK, params)
    _sparse_adam[(triton.cdiv(chunks, B),)](
        params, first_moment, second_moment, *grad, step, rates, rates.shape[0], eps, beta1,
        beta2, stepped_at, chunks, B=B,
    )  # fmt: skip


@triton.jit(do_not_specialize=["chunks"])
def _sparse_adam(
    parameters, first_moment, second_moment, values, touched, step, rates, regions, eps, beta1, beta2,
    stepped_at, chunks, B: tl.constexpr,
):  # fmt: skip
    chunk = tl.program_id(0) * B + tl.arange(0, B)
    on = tl.load(touched + chunk, mask=chunk < chunks, other=0) != 0
    if tl.max(on.to(tl.int32), axis=0) > 0:
        rate = tl.zeros([B], tl.float32)
        moves = tl.zeros([B], tl.int1)
        for region in range(regions):
            first = (tl.load(rates + 3 * region).to(tl.int64) // 16).to(tl.int32)
            last = (tl.load(rates + 3 * region + 1).to(tl.int64) // 16).to(tl.int32)
            here = on & (chunk >= first) & (chunk < last)
            rate = tl.where(here, tl.load(rates + 3 * region + 2).to(tl.float32), rate)
            moves = moves | here
        now = tl.load(step)
        correction1 = _one_less_power(beta1, now)
        correction2 = tl.sqrt(_one_less_power(beta2, now))
        k = chunk[:, None] * 16 + tl.arange(0, 16)[None, :]
        mask = moves[:, None] & (k >= 0)
        g = tl.load(values + k, mask=mask, other=0.0)
        m = beta1 * tl.load(first_moment + k, mask=mask, other=0.0) + (1.0 - beta1) * g
        v = beta2 * tl.load(second_moment + k, mask=mask, other=0.0) + (1.0 - beta2) * g * g
        p = tl.load(parameters + k, mask=mask, other=0.0)
        p -= (rate / correction1)[:, None] * m / (tl.sqrt(v) / correction2 + eps)
        tl.store(parameters + k, p, mask=mask)
        tl.store(first_moment + k, m, mask=mask)
        tl.store(second_moment + k, v, mask=mask)
        tl.store(values + k, tl.zeros([B, 16], tl.float32), mask=mask)
        tl.store(touched + chunk, tl.zeros([B], tl.uint8), mask=moves)
        tl.store(stepped_at + chunk, tl.zeros([B], tl.int32) + now, mask=moves)


@triton.jit
def _one_less_power(base, exponent):
    """1 - base^exponent as float32; the power by squaring, in float64."""
    power = tl.full([], 1.0, tl.float64)
    square = tl.full([], 1.0, tl.float64) * base
    for bit in range(31):
        power = tl.where((exponent >> bit) & 1 != 0, power * square, power)
        square = square * square
    return (1.0 - power).to(tl.float32)
