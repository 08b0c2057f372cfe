"""Colour loss."""

from torch import Tensor

from hsslam_node.losses.masked_mean import masked_mean


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
