"""Structural loss over virtual patches on the GPU, with its gradient.

Twin: `kernels/mapping/patch_ssim.py`.
"""

import triton
import triton.language as tl
from torch import Tensor

from hsslam_node.gpu_kernels.block_size import block_size

BLOCK = 32  # windows of one program
_C1, _C2 = tl.constexpr(0.01**2), tl.constexpr(0.03**2)


def patch_ssim_backward(
    color: Tensor,
    measured: Tensor,
    windows: Tensor,
    window_count: Tensor,
    window_weight: Tensor,
    scale: float,
    d_color: Tensor,
    loss: Tensor,
) -> None:
    """Write 1 - mean SSIM to `loss` [1]; add `scale` times its gradient to d_color [R, 3].

    color, measured: [R, 3] 0..1; windows [W, k^2] int32 ray indices, of which the first `window_count` [1]
    int32 count (0: the loss is 0); window_weight [k^2], sum 1.
    """
    W, K = windows.shape
    loss.zero_()
    if W == 0:
        return
    B = block_size(BLOCK, color)
    _patch_ssim_backward[(triton.cdiv(W, B),)](
        color, measured, windows, window_count, window_weight, scale, d_color, loss, W, K,
        KP=triton.next_power_of_2(K), B=B,
    )  # fmt: skip


@triton.jit(do_not_specialize=["W"])
def _patch_ssim_backward(
    color, measured, windows, window_count, window_weight, scale, d_color, loss, W, K,
    KP: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    count = tl.minimum(tl.load(window_count), W)
    w = tl.program_id(0) * B + tl.arange(0, B)
    k = tl.arange(0, KP)[None, :]
    real = w < count
    on = real[:, None] & (k < K)
    ray = tl.load(windows + w[:, None] * K + k, mask=on, other=0)
    g = tl.load(window_weight + k, mask=k < K, other=0.0)
    mean = 1.0 / (3.0 * tl.maximum(count, 1).to(tl.float32))
    total = tl.zeros([B], tl.float32)
    for c in tl.static_range(3):
        x = tl.load(color + 3 * ray + c, mask=on, other=0.0)
        y = tl.load(measured + 3 * ray + c, mask=on, other=0.0)
        mx = tl.sum(g * x, axis=1)
        my = tl.sum(g * y, axis=1)
        dx = x - mx[:, None]
        dy = y - my[:, None]
        l_down = mx * mx + my * my + _C1
        s_down = tl.sum(g * dx * dx, axis=1) + tl.sum(g * dy * dy, axis=1) + _C2
        luminance = (2.0 * mx * my + _C1) / l_down
        structure = (2.0 * tl.sum(g * dx * dy, axis=1) + _C2) / s_down
        total += tl.where(real, 1.0 - luminance * structure, 0.0)
        # gradient by the mean, and by the deviation of each pixel from it
        d_mean = structure * 2.0 * (my - luminance * mx) / l_down
        d_pixel = (2.0 * luminance / s_down)[:, None] * (dy - structure[:, None] * dx)
        d = -scale * mean * g * (d_mean[:, None] + d_pixel)
        tl.atomic_add(d_color + 3 * ray + c, d, mask=on, sem="relaxed")
    tl.atomic_add(loss, tl.sum(total, axis=0) * mean, sem="relaxed")
