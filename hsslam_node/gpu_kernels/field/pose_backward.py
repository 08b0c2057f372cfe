"""Backward pass of the field to sample positions only, for a pose; a file of its own as its twin is.

Twin: `kernels/field/pose_backward.py`.
"""

from torch import Tensor

from hsslam_node.gpu_kernels.field.activations import FieldActivations
from hsslam_node.gpu_kernels.field.decoder_backward import color_backward, geometry_backward
from hsslam_node.gpu_kernels.field.layout import GpuLayout
from hsslam_node.gpu_kernels.field.position_backward import position_backward


def field_pose_backward(
    params: Tensor,
    layout: GpuLayout,
    n: int,
    acts: FieldActivations,
    d_sdf: Tensor,
    d_rgb: Tensor,
    d_points: Tensor,
) -> None:
    """Write d_points [N, 3] (1/m) as `field_backward` does, without the gradient by the parameters.

    `acts` as `field_forward` left it for the first n points; d_sdf [N], d_rgb [N, 3] are the loss
    gradients. Points outside the bound get zero.
    """
    if n == 0:
        return
    color_backward(params, layout, n, acts, d_rgb, None)
    geometry_backward(params, layout, n, acts, d_sdf, None)
    position_backward(params, layout, n, acts, d_points)
