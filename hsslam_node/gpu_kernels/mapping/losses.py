"""The per-ray losses on the GPU, with their gradients by SDF and colour of the samples.

Twin: `kernels/mapping/rendering.py`.
"""

import triton
import triton.language as tl
from torch import Tensor

from hsslam_node.gpu_kernels.block_size import block_size

BLOCK = 8  # rays of one program
_MIDDLE = tl.constexpr(0.4)  # as reference/losses.py
_COLOR, _DEPTH, _SDF_MIDDLE, _SDF_TAIL, _FREE_SPACE = (tl.constexpr(k) for k in range(5))


def losses_backward(
    sdf: Tensor,
    rgb: Tensor,
    inside: Tensor,
    z: Tensor,
    log_beta: Tensor,
    weights: Tensor,
    color: Tensor,
    depth: Tensor,
    measured_color: Tensor,
    measured_depth: Tensor,
    ray_weight: Tensor,
    loss_weight: Tensor,
    truncation_m: float,
    free_sdf: float,
    d_color_extra: Tensor,
    ray_count: Tensor,
    d_sdf: Tensor,
    d_rgb: Tensor,
    ray_loss: Tensor,
    terms: Tensor,
    d_log_beta: Tensor,
) -> None:
    """Losses of the first `ray_count` rays and their gradients by SDF [R, S] and colour [R, S, 3].

    `free_sdf` is that of `free_space_loss`.
    `loss_weight` [5] and `terms` [5] are in the order colour, depth, SDF middle, SDF tail, free space;
    `ray_weight` [R] scales the depth and SDF terms of a ray (its depth noise), and the colour of a ray
    without depth; `d_color_extra` [R, 3] is the gradient of other losses by the rendered colour;
    `ray_count` [1] int32. `ray_loss` [R] becomes the weighted loss of each ray, `terms` the terms, and the
    gradient by log beta is added to `d_log_beta` [1]. Rays beyond `ray_count` get zeros. See
    `reference/losses.py`.
    """
    R, S = z.shape
    terms.zero_()
    B = block_size(BLOCK, z)
    _losses_backward[(triton.cdiv(R, B),)](
        sdf, rgb, inside, z, log_beta, weights, color, depth, measured_color, measured_depth,
        ray_weight, loss_weight, truncation_m, free_sdf, d_color_extra, ray_count, R, S, d_sdf, d_rgb,
        ray_loss, terms, d_log_beta, SP=triton.next_power_of_2(S), B=B,
    )  # fmt: skip


@triton.jit(do_not_specialize=["R"], do_not_specialize_on_alignment=["log_beta", "d_log_beta"])
def _losses_backward(
    sdf, rgb, inside, z, log_beta, weights, color, depth, measured_color, measured_depth,
    ray_weight, loss_weight, T, free_sdf, d_color_extra, ray_count, R, S, d_sdf, d_rgb, ray_loss, terms,
    d_log_beta, SP: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    count = tl.load(ray_count)
    r = tl.program_id(0) * B + tl.arange(0, B)
    s = tl.arange(0, SP)
    real = (r < R) & (r < count)
    row = r[:, None]
    k = row * S + s[None, :]
    on = (r < R)[:, None] & (s < S)[None, :]
    live = tl.load(inside + k, mask=on & real[:, None], other=0) != 0
    per_ray = 1.0 / tl.maximum(count, 1).to(tl.float32)
    per_depth = 1.0 / tl.maximum(_rays_with_depth(measured_depth, tl.minimum(count, R)), 1.0)
    D = tl.load(measured_depth + r, mask=real, other=0.0)
    trust = tl.load(ray_weight + r, mask=real & (D > 0), other=0.0)
    phi = tl.load(sdf + k, mask=live, other=1.0)
    distance = tl.load(z + k, mask=live, other=0.0)
    w = tl.load(weights + k, mask=live, other=0.0)

    # colour and depth: g, the gradient by the weight of each sample
    loss = tl.zeros([B], tl.float32)
    g = tl.zeros([B, SP], tl.float32)
    blind = tl.load(ray_weight + r, mask=real & (D <= 0), other=1.0)
    k_color = tl.load(loss_weight + _COLOR) * blind
    for c in tl.static_range(3):
        e = tl.load(color + 3 * r + c, mask=real, other=0.0)
        e -= tl.load(measured_color + 3 * r + c, mask=real, other=0.0)
        loss += e * e / 3.0
        extra = tl.load(d_color_extra + 3 * r + c, mask=real, other=0.0)
        d_color = (k_color * (2.0 / 3.0) * per_ray * e + extra)[:, None]
        g += d_color * tl.load(rgb + 3 * k + c, mask=live, other=0.0)
        tl.store(d_rgb + 3 * k + c, w * d_color, mask=on)
    tl.atomic_add(terms + _COLOR, tl.sum(loss * blind, axis=0) * per_ray, sem="relaxed")
    loss *= k_color
    e = tl.load(depth + r, mask=real, other=0.0) - D
    square = e * e * trust
    tl.atomic_add(terms + _DEPTH, tl.sum(square, axis=0) * per_depth, sem="relaxed")
    k_depth = tl.load(loss_weight + _DEPTH)
    loss += k_depth * square
    g += (k_depth * 2.0 * per_depth * e * trust)[:, None] * distance

    # through the rendering: dL/dsigma = transmittance behind the sample * g - sum of w g behind it
    beta = tl.exp(tl.load(log_beta))
    sigmoid = tl.sigmoid(-beta * phi)
    after = tl.exp(-tl.cumsum(tl.where(live, beta * sigmoid, 0.0), axis=1))
    behind = tl.cumsum(w * g, axis=1, reverse=True) - w * g
    d_sigma = tl.where(live, after * g - behind, 0.0)
    slope = beta * beta * sigmoid * (1.0 - sigmoid)
    d = -d_sigma * slope
    d_beta = tl.sum(tl.sum(d_sigma * (beta * sigmoid - phi * slope), axis=1), axis=0)
    tl.atomic_add(d_log_beta, d_beta, sem="relaxed")

    # the signed distance itself
    measured = live & (D > 0)[:, None]
    offset = distance - D[:, None]
    free = measured & (offset < -T)
    band = measured & (tl.abs(offset) < T)
    middle = band & (tl.abs(offset) < _MIDDLE * T)
    tail = band & (tl.abs(offset) >= _MIDDLE * T)
    one = tl.full([B], 1.0, tl.float32)
    e = phi - free_sdf
    e = tl.where((free_sdf < 1.0) & (e > 0.0), 0.0, e)
    part, d_part = _sample_term(e, free, one, per_depth, loss_weight, terms, _FREE_SPACE)
    loss += part
    d += d_part
    e = phi * T + offset
    part, d_part = _sample_term(e, middle, trust, per_depth, loss_weight, terms, _SDF_MIDDLE)
    loss += part
    d += d_part * T
    part, d_part = _sample_term(e, tail, trust, per_depth, loss_weight, terms, _SDF_TAIL)
    loss += part
    d += d_part * T
    tl.store(d_sdf + k, d, mask=on)
    tl.store(ray_loss + r, loss, mask=r < R)


@triton.jit
def _sample_term(e, which, trust, per_depth, loss_weight, terms, term: tl.constexpr):
    """Mean of e^2 over a ray's samples `which`: its weighted loss [B] and gradient by e [B, SP]."""
    n = tl.maximum(tl.sum(which.to(tl.float32), axis=1), 1.0)
    scale = trust / n
    mean = scale * tl.sum(tl.where(which, e * e, 0.0), axis=1)
    tl.atomic_add(terms + term, tl.sum(mean, axis=0) * per_depth, sem="relaxed")
    weight = tl.load(loss_weight + term)
    d = tl.where(which, (2.0 * weight * per_depth * scale)[:, None] * e, 0.0)
    return weight * mean, d


@triton.jit
def _rays_with_depth(measured_depth, count):
    total = tl.zeros([1024], tl.float32)
    for start in range(0, count, 1024):
        r = start + tl.arange(0, 1024)
        total += (tl.load(measured_depth + r, mask=r < count, other=0.0) > 0.0).to(tl.float32)
    return tl.sum(total, axis=0)
