"""Everything that a mapping step on the GPU reads and writes, allocated once and never moved."""

import math

import numpy as np
import torch

from hsslam_node.config import SlamConfig
from hsslam_node.device.device import Device
from hsslam_node.device.staged_array import StagedArray
from hsslam_node.gpu_kernels.field.activations import gradient
from hsslam_node.gpu_kernels.field.layout import GpuLayout
from hsslam_node.mapping.gpu.batch import GpuBatch
from hsslam_node.mapping.ray_batch import RayBatch
from hsslam_node.mapping.step_inputs import window_weights

_RATE_REGIONS = 4


class GpuWorkSpace:
    """Inputs as `StagedArray`s, results and intermediate values as tensors, for up to `rays` rays.

    Steps always run over all rows; `window_count` is the number of valid windows.
    """

    def __init__(self, config: SlamConfig, layout: GpuLayout, rays: int, device: Device) -> None:
        m, w = config.mapper, config.weights
        slots = max(m.window_keyframes, config.ba.top_keyframes, config.ba.probe_keyframes)

        def staged(*shape: int, dtype: torch.dtype = torch.float32) -> StagedArray:
            return StagedArray(shape, dtype, device)

        def tensor(*shape: int, dtype: torch.dtype = torch.float32) -> torch.Tensor:
            return torch.zeros(shape, dtype=dtype, device=device.tensors_on)

        truncation_m = config.field.truncation_m
        self.batch = GpuBatch(
            layout, rays, slots, config.sampling, truncation_m, w.free_sdf, device
        )
        self.ray_weight = staged(rays)
        self.windows = staged(_most_windows(rays, config), m.patch_kernel_px**2, dtype=torch.int32)
        self.cube = staged(*3 * (m.smoothness_vertices,), 3)
        self.window_count = staged(1, dtype=torch.int32)
        self.step = staged(1, dtype=torch.int32)
        self.rates = staged(_RATE_REGIONS, 3, dtype=torch.float64)

        self.loss_weight = tensor(5)
        self.loss_weight[:] = torch.tensor(
            [w.color, w.depth, w.sdf_middle, w.sdf_tail, w.free_space]
        )
        self.window_weight = window_weights(m.patch_kernel_px).float().to(device.tensors_on)
        self.gradient = gradient(layout)
        self.d_color = tensor(rays, 3)
        self.feature = tensor(m.smoothness_vertices**3, max(2 * layout.levels, 1))

        # results, fetched after the step
        self.terms = staged(8)  # five of the rays, patch, smoothness, d_log_beta of a probe
        self.inside_count = staged(1, dtype=torch.int64)

        b = self.batch
        self.host_rays = RayBatch(
            b.direction.host, b.depth.host, b.color.host, np.zeros(rays, np.int64)
        )


def _most_windows(rays: int, config: SlamConfig) -> int:
    """Number of windows in the patches of a full batch, 1 at least."""
    m = config.mapper
    along = max((math.isqrt(rays) - m.patch_kernel_px) // m.patch_stride_px + 1, 0)
    return max(m.patch_repeats * along * along, 1)
