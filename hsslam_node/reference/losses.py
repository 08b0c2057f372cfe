"""Reference of `kernels/mapping/rendering.py`, `kernels/mapping/patch_ssim.py` and
`kernels/mapping/smoothness.py`.

The loss terms of mapping and bundle adjustment. A mean over no ray is 0.
"""

import torch
from torch import Tensor

from hsslam_node.mapping.step_inputs import window_rays, window_weights


def masked_mean(values: Tensor, mask: Tensor | None) -> Tensor:
    """Mean of the values [N] where the mask [N] holds (None: everywhere); 0 over nothing."""
    if mask is None:
        mask = torch.ones_like(values, dtype=torch.bool)
    return torch.where(mask, values, 0.0).sum() / mask.sum().clamp(min=1)


def mean_of_ray_means(values: Tensor, mask: Tensor, rays: Tensor) -> Tensor:
    """Mean over rays of each ray's mean over its masked samples; 0 over nothing.

    A ray that counts but has no sample in the mask contributes 0.

    Args:
        values: [R, S].
        mask: [R, S] bool, samples that count.
        rays: [R] bool, rays that count.
    """
    total = torch.where(mask, values, 0.0).sum(dim=-1)  # [R]
    return masked_mean(total / mask.sum(dim=-1).clamp(min=1), rays)


def color_loss(color: Tensor, measured: Tensor, valid: Tensor | None = None) -> Tensor:
    """Mean squared difference of rendered and measured colour, over rays and channels.

    Args:
        color: [R, 3] rendered, 0..1.
        measured: [R, 3].
        valid: [R] bool, rays that count; None: all. Without any the loss is 0.

    Source: paper III-B.
    """
    squared = (color - measured).square().mean(dim=-1)  # [R]
    return masked_mean(squared, valid)


def depth_loss(depth: Tensor, measured: Tensor) -> Tensor:
    """Mean squared difference of rendered and measured depth, m^2, over rays with a measurement.

    Args:
        depth: [R] m, rendered.
        measured: [R] m, 0 = no measurement.

    Source: paper III-B.
    """
    return masked_mean((depth - measured).square(), measured > 0)


MIDDLE = 0.4  # half width of the middle of the band, in units of the truncation (ESLAM)


def sdf_losses(
    sdf: Tensor, z: Tensor, measured: Tensor, inside: Tensor, truncation_m: float
) -> tuple[Tensor, Tensor]:
    """Squared error of the signed distance in the middle and in the tail of the band, m^2.

    The target at a sample is D - z. Middle: |z - D| < 0.4 T; tail: the rest of |z - D| < T.
    Each is the mean over rays with depth of the ray's mean over its samples there, 0 where it has
    none. The paper's equation lacks the square.

    Args:
        sdf: [R, S] in units of the truncation.
        z: [R, S] m, planar depth of the samples.
        measured: [R] m, D, 0 = no measurement.
        inside: [R, S] bool, samples within the bound.
        truncation_m: T, m.

    Returns:
        middle loss, tail loss

    Source: paper III-B; Johari et al., ESLAM (2023).
    """
    offset = z - measured[:, None]  # [R, S] m
    squared = (sdf * truncation_m + offset).square()
    rays = measured > 0
    usable = inside & rays[:, None]
    middle = usable & (offset.abs() < MIDDLE * truncation_m)
    tail = usable & (offset.abs() < truncation_m) & ~middle
    return mean_of_ray_means(squared, middle, rays), mean_of_ray_means(squared, tail, rays)


def free_space_loss(
    sdf: Tensor,
    z: Tensor,
    measured: Tensor,
    inside: Tensor,
    truncation_m: float,
    free_sdf: float = 1.0,
) -> Tensor:
    """Squared difference of the signed distance from `free_sdf` in front of the surface (z < D - T).

    With `free_sdf` below 1, samples with a larger signed distance have no loss: along a ray that meets the
    surface at a small angle, they are closer to it than T, and 1 would be wrong there.

    The paper's condition |z - D| >= T would make the space behind surfaces free; that space is not
    supervised here. Mean over rays with depth of the ray's mean over its samples there.

    Args:
        sdf: [R, S] in units of the truncation.
        z: [R, S] m, planar depth of the samples.
        measured: [R] m, D, 0 = no measurement.
        inside: [R, S] bool, samples within the bound.
        truncation_m: T, m.
        free_sdf: in units of the truncation; 1 in the paper.

    Source: paper III-B.
    """
    rays = measured > 0
    free = inside & rays[:, None] & (z < measured[:, None] - truncation_m)
    e = sdf - free_sdf if free_sdf == 1.0 else (sdf - free_sdf).clamp(max=0.0)
    return mean_of_ray_means(e.square(), free, rays)


_C1, _C2 = 0.01**2, 0.03**2  # SSIM's constants for a range of 1


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


def smoothness_loss(feature: Tensor) -> Tensor:
    """Squared differences of the feature between neighbouring vertices, per vertex.

    Args:
        feature: [n, n, n, F] hash feature at the vertices of a cube.

    Source: paper III-B; Wang et al., Co-SLAM (2023).
    """
    squares = [feature.diff(dim=axis).square().sum() for axis in range(3)]
    return (squares[0] + squares[1] + squares[2]) / feature[..., 0].numel()
