"""A batch of rays on the device, for mapping and for tracking by rendering.

Twin: `BatchPart` in `mapping/batch_part.py`.
"""

import torch
from torch import Tensor

from hsslam_node.device.device import Device
from hsslam_node.device.staged_array import StagedArray
from hsslam_node.gpu_kernels.field.activations import field_activations
from hsslam_node.gpu_kernels.field.forward import field_forward
from hsslam_node.gpu_kernels.field.layout import GpuLayout
from hsslam_node.gpu_kernels.mapping.losses import losses_backward
from hsslam_node.gpu_kernels.mapping.ray_batch import GpuRays, place_samples, pose_gradients
from hsslam_node.gpu_kernels.mapping.rendering import render_forward
from hsslam_node.rendering.ray_sampling import SamplingPattern


class GpuBatch:
    """Inputs, results and all between of up to R rays; launches always run over all R.

    The caller sets and sends `direction`, `depth`, `color`, `slot`, `jitter`, `poses` and `ray_count`, the
    number of valid rays. The methods only launch kernels, on tensors at fixed addresses.
    """

    def __init__(
        self,
        layout: GpuLayout,
        rays: int,
        slots: int,
        sampling: SamplingPattern,
        truncation_m: float,
        free_sdf: float,
        device: Device,
    ) -> None:
        R, S = rays, sampling.count
        self._sampling = sampling
        self._truncation_m, self._free_sdf = truncation_m, free_sdf

        def staged(*shape: int, dtype: torch.dtype = torch.float32) -> StagedArray:
            return StagedArray(shape, dtype, device)

        def tensor(*shape: int) -> Tensor:
            return torch.zeros(shape, dtype=torch.float32, device=device.tensors_on)

        self.direction, self.depth, self.color = staged(R, 3), staged(R), staged(R, 3)
        self.slot = staged(R, dtype=torch.int32)
        self.jitter = staged(R, S)
        self.poses = staged(slots, 3, 4)
        self.ray_count = staged(1, dtype=torch.int32)

        self.acts = field_activations(layout, R * S)
        self.rendered_color, self.rendered_depth = tensor(R, 3), tensor(R)
        self.ray_loss = staged(R)
        self.d_sdf, self.d_rgb = tensor(R * S), tensor(R * S, 3)
        self.d_points = tensor(R * S, 3)
        self.d_twist = staged(slots, 6)
        self._points, self._z = tensor(R * S, 3), tensor(R, S)
        self._weights, self._opacity = tensor(R, S), tensor(R)
        self._rays = GpuRays(
            self.direction.tensor, self.depth.tensor, self.color.tensor, self.slot.tensor
        )

    @property
    def samples(self) -> int:
        """Number of samples of all R rays."""
        return len(self._points)

    def render(self, params: Tensor, layout: GpuLayout) -> None:
        """Place the samples of the rays and render them."""
        s = self._sampling
        place_samples(
            self._rays, self.ray_count.tensor, self.poses.tensor, self.jitter.tensor,
            s.free_samples, s.surface_samples, s.free_reach, s.surface_reach * self._truncation_m,
            self._z, self._points,
        )  # fmt: skip
        field_forward(params, layout, self._points, self.samples, self.acts)
        render_forward(
            *self._field_at_samples(), self._z, _log_beta(params, layout), self._weights,
            self.rendered_color, self.rendered_depth, self._opacity,
        )  # fmt: skip

    def judge(
        self,
        params: Tensor,
        layout: GpuLayout,
        loss_weight: Tensor,
        color: Tensor,
        depth: Tensor,
        ray_weight: Tensor,
        d_color: Tensor,
        terms: Tensor,
        d_log_beta: Tensor,
    ) -> None:
        """Losses of the rendered rays against `color` [R, 3] and `depth` [R]; see `losses_backward`."""
        losses_backward(
            *self._field_at_samples(), self._z, _log_beta(params, layout), self._weights,
            self.rendered_color, self.rendered_depth, color, depth, ray_weight, loss_weight,
            self._truncation_m, self._free_sdf, d_color, self.ray_count.tensor, self.d_sdf, self.d_rgb,
            self.ray_loss.tensor, terms, d_log_beta,
        )  # fmt: skip

    def add_up_poses(self) -> None:
        """The gradient by the poses, `d_twist`, from that by the samples, `d_points`."""
        self.d_twist.tensor.zero_()
        pose_gradients(
            self._rays, self.ray_count.tensor, self.poses.tensor, self._z, self.d_points,
            self.d_twist.tensor,
        )  # fmt: skip

    def _field_at_samples(self) -> tuple[Tensor, Tensor, Tensor]:
        """SDF [R, S], colour [R, S, 3] and `inside` [R, S] of all samples."""
        acts, (R, S) = self.acts, self._z.shape
        return acts.sdf.view(R, S), acts.rgb.view(R, S, 3), acts.inside.view(R, S)


def _log_beta(params: Tensor, layout: GpuLayout) -> Tensor:
    return params[layout.log_beta : layout.log_beta + 1]
