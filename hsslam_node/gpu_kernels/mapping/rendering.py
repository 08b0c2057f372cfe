"""Volume rendering on the GPU, forward (its backward pass is part of `gpu_kernels/mapping/losses.py`).

Twin: `kernels/mapping/rendering.py`.
"""

import triton
import triton.language as tl
from torch import Tensor

from hsslam_node.gpu_kernels.block_size import block_size

BLOCK = 8  # rays of one program


def render_forward(
    sdf: Tensor,
    rgb: Tensor,
    inside: Tensor,
    z: Tensor,
    log_beta: Tensor,
    weights: Tensor,
    color: Tensor,
    depth: Tensor,
    opacity: Tensor,
) -> None:
    """Render rays from samples sorted near to far (twin of reference/rendering.py).

    sdf, z, inside (uint8): [R, S]; rgb: [R, S, 3]; log_beta [1]. Writes weights [R, S], color [R, 3], depth
    [R] m and opacity [R].
    """
    R, S = z.shape
    B = block_size(BLOCK, z)
    _render_forward[(triton.cdiv(R, B),)](
        sdf, rgb, inside, z, log_beta, R, S, weights, color, depth, opacity,
        SP=triton.next_power_of_2(S), B=B,
    )  # fmt: skip


@triton.jit(do_not_specialize=["R"], do_not_specialize_on_alignment=["log_beta"])
def _render_forward(
    sdf, rgb, inside, z, log_beta, R, S, weights, color, depth, opacity,
    SP: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    r = tl.program_id(0) * B + tl.arange(0, B)
    s = tl.arange(0, SP)
    on = (r < R)[:, None] & (s < S)[None, :]
    k = r[:, None] * S + s[None, :]
    live = tl.load(inside + k, mask=on, other=0) != 0
    beta = tl.exp(tl.load(log_beta))
    phi = tl.load(sdf + k, mask=live, other=0.0)
    sigma = tl.where(live, beta * tl.sigmoid(-beta * phi), 0.0)
    w = termination(sigma)
    tl.store(weights + k, w, mask=on)
    for c in tl.static_range(3):
        channel = tl.load(rgb + 3 * k + c, mask=live, other=0.0)
        tl.store(color + 3 * r + c, tl.sum(w * channel, axis=1), mask=r < R)
    distance = tl.load(z + k, mask=live, other=0.0)
    tl.store(depth + r, tl.sum(w * distance, axis=1), mask=r < R)
    tl.store(opacity + r, tl.sum(w, axis=1), mask=r < R)


@triton.jit
def termination(sigma):
    """Probability that a ray ends at each sample, [B, SP], from its density there."""
    before = tl.cumsum(sigma, axis=1) - sigma
    small = sigma * (1.0 - 0.5 * sigma * (1.0 - sigma / 3.0))  # here 1 - exp(-sigma) cancels
    alpha = tl.where(sigma < 0.01, small, 1.0 - tl.exp(-sigma))
    return tl.exp(-before) * alpha
