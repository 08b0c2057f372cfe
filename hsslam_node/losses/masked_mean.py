"""Means over subsets that may be empty."""

import torch
from torch import Tensor


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
