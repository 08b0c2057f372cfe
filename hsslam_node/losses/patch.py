"""Structural loss over random virtual patches (S3IM)."""

import math

import numpy as np
import torch
from torch import Tensor

KERNEL_SIGMA_PX = 1.5
_C1, _C2 = 0.01**2, 0.03**2  # SSIM's constants for a range of 1
SMALLEST_SIDE = 16


def patch_loss(
    color: Tensor, measured: Tensor, patches: Tensor, kernel: int = 3, stride: int = 4
) -> Tensor:
    """One minus the mean SSIM of M square patches of rays in random order.

    Windows lie wholly inside the patch (S3IM pads with zeros by a pixel; with these strides that
    only weakens the first row and column). Weights are Gaussian, sigma 1.5 px, as in S3IM. SSIM is
    averaged over patches, windows and channels.

    Args:
        color: [R, 3] rendered, 0..1.
        measured: [R, 3].
        patches: [M, side, side] int64 ray indices, from `random_patches`; M = 0 gives 0.
        kernel: window side, px.
        stride: window spacing, px.

    Source: paper III-B; Xie et al., S3IM (2023).
    """
    if len(patches) == 0:
        return color.sum() * 0.0
    rays = window_rays(patches, kernel, stride)  # [W, kernel^2]
    weight = window_weights(kernel).to(color)[:, None]  # [kernel^2, 1]
    x, y = color[rays], measured[rays]  # [W, kernel^2, 3]
    mean_x, mean_y = (weight * x).sum(dim=1), (weight * y).sum(dim=1)  # [W, 3]
    var_x = (weight * x * x).sum(dim=1) - mean_x**2
    var_y = (weight * y * y).sum(dim=1) - mean_y**2
    covariance = (weight * x * y).sum(dim=1) - mean_x * mean_y
    luminance = (2 * mean_x * mean_y + _C1) / (mean_x**2 + mean_y**2 + _C1)
    structure = (2 * covariance + _C2) / (var_x + var_y + _C2)
    return 1.0 - (luminance * structure).mean()


def random_patches(ray_count: int, repeats: int, generator: np.random.Generator) -> np.ndarray:
    """Ray indices [M, side, side] int64 of M random patches, each the largest square of the rays.

    M is 0 below 16 x 16 rays: too few for structure.
    """
    side = math.isqrt(ray_count)
    if side < SMALLEST_SIDE:
        return np.zeros((0, 0, 0), np.int64)
    orders = [generator.permutation(ray_count)[: side * side] for _ in range(repeats)]
    return (
        np.stack(orders).reshape(repeats, side, side) if orders else np.zeros((0, 0, 0), np.int64)
    )


def window_rays(patches: Tensor, kernel: int, stride: int) -> Tensor:
    """Ray indices [W, kernel^2] of all windows of all patches [M, side, side], row by row."""
    windows = patches.unfold(1, kernel, stride).unfold(2, kernel, stride)  # [M, n, n, k, k]
    return windows.reshape(-1, kernel * kernel)


def window_weights(kernel: int) -> Tensor:
    """Gaussian window [kernel^2] float64, sum 1, row by row."""
    offset = torch.arange(kernel, dtype=torch.float64) - kernel // 2
    profile = torch.exp(-(offset**2) / (2 * KERNEL_SIGMA_PX**2))
    profile = profile / profile.sum()
    return (profile[:, None] * profile[None, :]).flatten()
