"""Backward pass of the field to the sample positions alone, for a pose with the map held still."""

from torch import Tensor

from hsslam_node.gpu_kernels.activations import FieldActivations, Gradient
from hsslam_node.gpu_kernels.decoder_backward import color_backward, geometry_backward
from hsslam_node.gpu_kernels.gpu_layout import GpuLayout
from hsslam_node.gpu_kernels.position_backward import position_backward


def field_pose_backward(
    params: Tensor,
    layout: GpuLayout,
    n: int,
    acts: FieldActivations,
    d_sdf: Tensor,
    d_rgb: Tensor,
    scratch: Gradient,
    d_points: Tensor,
) -> None:
    """Write d_points [N, 3] (1/m): what `field_backward` writes, without scattering to the encodings.

    The decoders' gradient falls into `scratch`, which nobody reads.
    """
    if n == 0:
        return
    color_backward(params, layout, n, acts, d_rgb, scratch)
    geometry_backward(params, layout, n, acts, d_sdf, scratch)
    position_backward(params, layout, n, acts, d_points)
