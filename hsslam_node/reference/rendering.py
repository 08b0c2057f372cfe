"""Reference of `kernels/mapping/rendering.py`.

Volume rendering of colour and depth from signed distances.
"""

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class RenderedRays:
    """The rendered values of R rays."""

    color: Tensor  # [R, 3] RGB
    depth: Tensor  # [R] m, planar
    opacity: Tensor  # [R] 0..1, sum of the weights; colour and depth are not divided by it
    weights: Tensor  # [R, S] termination probability of each sample


def render_rays(
    sdf: Tensor, color: Tensor, z: Tensor, beta: Tensor | float, inside: Tensor | None = None
) -> RenderedRays:
    """Render rays whose samples are sorted near to far.

    sigma = beta sigmoid(-beta sdf); alpha = 1 - exp(-sigma); weight = alpha times the transmittance
    of the samples before. The density is per sample, not per metre: the sampling pattern is part
    of the model.

    Args:
        sdf: [R, S] in units of the truncation.
        color: [R, S, 3] 0..1.
        z: [R, S] m, planar depth.
        beta: sharpness, scalar.
        inside: [R, S] bool; samples outside the bound are empty. None: all inside.

    Source: paper III-B; Or-El et al., StyleSDF (2022).
    """
    sigma = beta * torch.sigmoid(-beta * sdf)  # [R, S]
    if inside is not None:
        sigma = torch.where(inside, sigma, 0.0)
    before = sigma.cumsum(dim=-1) - sigma  # optical depth in front of each sample
    weights = torch.exp(-before) * -torch.expm1(-sigma)  # [R, S]
    return RenderedRays(
        color=(weights[..., None] * color).sum(dim=-2),
        depth=(weights * z).sum(dim=-1),
        opacity=weights.sum(dim=-1),
        weights=weights,
    )
