"""The kernel layout on the device: two small tables that all field kernels read.

Twin: `kernels/field/layout.py`.
"""

from dataclasses import dataclass

import numpy as np
import torch
import triton.language as tl
from torch import Tensor

from hsslam_node.kernels.field.layout import KernelLayout
from hsslam_node.map.layout import PLANE_AXES

HIDDEN = 32

# ints: decoder offsets [4], planes [12, 5] (offset, first vertex u, v, vertices u, v); hash grid,
# [L] each: offset, mask, first vertex x, y, z, vertices x, y, z
PLANES = tl.constexpr(4)
LEVELS = tl.constexpr(64)
# floats: low [3], high [3], origin [3], inverse extent [3], inverse cells [4], hash scale [L]
ORIGIN = tl.constexpr(6)
INVERSE_EXTENT = tl.constexpr(9)
CELLS = tl.constexpr(12)
SCALES = tl.constexpr(16)


@dataclass(frozen=True)
class GpuLayout:
    """A `KernelLayout` with its arrays on a device, and the sizes that kernels are compiled for."""

    ints: Tensor  # [64 + 8 L] int32
    floats: Tensor  # [16 + L] float32
    channels: int  # C, of the planes; 0: none
    levels: int  # L, of the hash grid; 0: none
    blob_rows: int  # 48, or 0 without one-blob
    first_decoder_chunk: int  # 16-float chunks of the decoders, the last one included
    last_decoder_chunk: int
    log_beta: int  # offset in floats
    parameter_count: int

    @property
    def device(self) -> torch.device:
        """The device of the tables."""
        return self.ints.device

    @property
    def geometry_width(self) -> int:
        """Columns of `FieldActivations.geometry_in`, 2 L + 2 C."""
        return 2 * self.levels + 2 * self.channels

    @property
    def padded_levels(self) -> int:
        """Hash levels rounded up to a power of two, 16 at least, as `tl.dot` needs."""
        return 1 << (max(16, self.levels) - 1).bit_length()


def gpu_layout(layout: KernelLayout, device: torch.device | str) -> GpuLayout:
    """Copy the layout's tables to `device` (int32 offsets: at most 2^31 parameters)."""
    L = len(layout.hash_offset)
    decoders = [layout.geometry_W1, layout.geometry_W2, layout.color_W1, layout.color_W2]
    axes = np.asarray(PLANE_AXES)  # [3, 2]
    planes = np.concatenate(  # [4, 3, 5]
        [layout.plane_offset[..., None], layout.plane_first[:, axes], layout.plane_count[:, axes]],
        axis=-1,
    )
    ints = np.concatenate(
        [
            decoders,
            planes.ravel(),
            _hash_offset(layout),
            layout.hash_mask,
            layout.hash_first.T.ravel(),
            layout.hash_count.T.ravel(),
        ]
    )
    floats = np.concatenate(
        [
            layout.low,
            layout.high,
            layout.origin,
            layout.inv_extent,
            layout.plane_inv_cell,
            layout.hash_scale,
        ]
    )
    return GpuLayout(
        ints=torch.from_numpy(ints.astype(np.int32)).to(device),
        floats=torch.from_numpy(floats.astype(np.float32)).to(device),
        channels=layout.channels,
        levels=L,
        blob_rows=layout.blob_rows,
        first_decoder_chunk=layout.geometry_W1 >> 4,
        last_decoder_chunk=(layout.color_W2 + HIDDEN * 3 - 1) >> 4,
        log_beta=layout.log_beta,
        parameter_count=layout.parameter_count,
    )


def _hash_offset(layout: KernelLayout) -> np.ndarray:
    """Offset of vertex (0, 0, 0) of each level [L], or of the table if the level is hashed."""
    first, n_x, n_y = layout.hash_first, layout.hash_count[:, 0], layout.hash_count[:, 1]
    zero = -2 * (first[:, 0] + n_x * (first[:, 1] + n_y * first[:, 2]))
    return layout.hash_offset + np.where(layout.hash_mask == 0, zero, 0)
