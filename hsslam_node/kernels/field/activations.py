"""Work space of the field's forward and backward pass.

Twin: `gpu_kernels/field/activations.py`.
"""

from typing import NamedTuple

import numpy as np

from hsslam_node.kernels.field.decoder import HIDDEN
from hsslam_node.kernels.field.layout import KernelLayout
from hsslam_node.kernels.simd import aligned_zeros


class FieldActivations(NamedTuple):
    """For up to N points; C channels, L hash levels. Colour arrays have a row for each `color_row`."""

    axes: np.ndarray  # [3, N] m, positions from the origin of the layout
    inside: np.ndarray  # [N] uint8, 1 if the point is in the bound
    hash_feature: np.ndarray  # [L, N, 2], overwritten by its gradient in the backward pass
    geometry_in: np.ndarray  # [N, 2 L + 2 C]
    geometry_hidden: np.ndarray  # [N, 32], after ReLU
    geometry_out: np.ndarray  # [N, 16], column 0 before tanh
    color_rows: np.ndarray  # [1] int64, number of points with colour
    color_row: np.ndarray  # [N] int64, those points, ascending
    color_axes: np.ndarray  # [3, N] m, positions of those points
    color_in: np.ndarray  # [N, 2 C + 16], the last 16 are geometry_out (column 0 has zero weight)
    color_hidden: np.ndarray  # [N, 32], after ReLU
    sdf: np.ndarray  # [N] in units of the truncation
    rgb: np.ndarray  # [N, 3]
    d_geometry_out: np.ndarray  # [N, 16] gradient


def field_activations(layout: KernelLayout, point_count: int) -> FieldActivations:
    """Allocate work space for `point_count` points."""
    N, L, C2 = point_count, len(layout.hash_offset), 2 * layout.channels
    return FieldActivations(
        axes=aligned_zeros(3, N),
        inside=np.zeros(N, np.uint8),
        hash_feature=aligned_zeros(L, N, 2),
        geometry_in=aligned_zeros(N, 2 * L + C2),
        geometry_hidden=aligned_zeros(N, HIDDEN),
        geometry_out=aligned_zeros(N, 16),
        color_rows=np.zeros(1, np.int64),
        color_row=np.zeros(N, np.int64),
        color_axes=aligned_zeros(3, N),
        color_in=aligned_zeros(N, C2 + 16),
        color_hidden=aligned_zeros(N, HIDDEN),
        sdf=aligned_zeros(N),
        rgb=aligned_zeros(N, 3),
        d_geometry_out=aligned_zeros(N, 16),
    )
