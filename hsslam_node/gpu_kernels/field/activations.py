"""Work space and gradient of the field on the device.

Twins: `kernels/field/activations.py`, `kernels/field/gradient.py`.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from hsslam_node.gpu_kernels.field.layout import HIDDEN, GpuLayout


class FieldActivations(NamedTuple):
    """Work space for up to N points; C channels, L hash levels. float32 unless said otherwise."""

    position: Tensor  # [N, 3] m, relative to the low corner
    inside: Tensor  # [N] uint8, 1 if the point is in the bound
    geometry_in: Tensor  # [N, 2 L + 2 C]
    geometry_hidden: Tensor  # [N, 32], after ReLU
    geometry_out: Tensor  # [N, 16], column 0 before tanh
    color_in: Tensor  # [N, 2 C]
    color_hidden: Tensor  # [N, 32], after ReLU
    sdf: Tensor  # [N] in units of the truncation
    rgb: Tensor  # [N, 3]
    d_geometry_in: Tensor  # [N, 2 L + 2 C]; the backward pass writes this and all below
    d_geometry_hidden: Tensor  # [N, 32], before ReLU
    d_color_in: Tensor  # [N, 2 C]
    d_color_hidden: Tensor  # [N, 32], before ReLU


class Gradient(NamedTuple):
    """Dense gradient with a mark for each 16-float chunk that was written, for a sparse optimiser."""

    values: Tensor  # [P] float32, zero outside the touched chunks
    touched: Tensor  # [P / 16] uint8


def field_activations(layout: GpuLayout, point_count: int) -> FieldActivations:
    """Allocate work space for `point_count` points."""

    def zeros(*shape: int, dtype: torch.dtype = torch.float32) -> Tensor:
        return torch.zeros((point_count, *shape), dtype=dtype, device=layout.device)

    return FieldActivations(
        position=zeros(3),
        inside=zeros(dtype=torch.uint8),
        geometry_in=zeros(layout.geometry_width),
        geometry_hidden=zeros(HIDDEN),
        geometry_out=zeros(16),
        color_in=zeros(2 * layout.channels),
        color_hidden=zeros(HIDDEN),
        sdf=zeros(),
        rgb=zeros(3),
        d_geometry_in=zeros(layout.geometry_width),
        d_geometry_hidden=zeros(HIDDEN),
        d_color_in=zeros(2 * layout.channels),
        d_color_hidden=zeros(HIDDEN),
    )


def gradient(layout: GpuLayout) -> Gradient:
    """An empty gradient for all parameters."""
    P, device = layout.parameter_count, layout.device
    return Gradient(
        torch.zeros(P, dtype=torch.float32, device=device),
        torch.zeros(P // 16, dtype=torch.uint8, device=device),
    )
