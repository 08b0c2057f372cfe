"""Depth loss."""

from torch import Tensor

from hsslam_node.losses.masked_mean import masked_mean


def depth_loss(depth: Tensor, measured: Tensor) -> Tensor:
    """Mean squared difference of rendered and measured depth, m^2, over rays with a measurement.

    Args:
        depth: [R] m, rendered.
        measured: [R] m, 0 = no measurement.

    Source: paper III-B.
    """
    return masked_mean((depth - measured).square(), measured > 0)
