"""A mapping step on the device: which kernels it launches, in which order."""

from typing import NamedTuple

import torch
from torch import Tensor

from hsslam_node.config import SlamConfig
from hsslam_node.device.parameter_copy import ParameterCopy
from hsslam_node.gpu_kernels.field.backward import field_backward
from hsslam_node.gpu_kernels.field.forward import field_forward
from hsslam_node.gpu_kernels.field.layout import GpuLayout
from hsslam_node.gpu_kernels.mapping.adam import sparse_adam
from hsslam_node.gpu_kernels.mapping.losses import losses_backward
from hsslam_node.gpu_kernels.mapping.patch_ssim import patch_ssim_backward
from hsslam_node.gpu_kernels.mapping.ray_batch import place_samples, pose_gradients
from hsslam_node.gpu_kernels.mapping.rendering import render_forward
from hsslam_node.gpu_kernels.mapping.smoothness import smoothness_backward
from hsslam_node.mapping.gpu.work_space import GpuWorkSpace
from hsslam_node.mapping.map_optimiser import ADAM_BETA1, ADAM_BETA2, ADAM_EPS

# of the results `terms`: five of the rays, patch, smoothness, gradient by log beta of a probe
TERMS, PATCH, SMOOTH, _PROBE = slice(0, 5), slice(5, 6), slice(6, 7), slice(7, 8)


class StepParts(NamedTuple):
    """Which terms a step has; steps with equal parts launch the same work."""

    update: bool
    poses: bool
    patch: bool
    cube: bool


class DeviceStep:
    """Launches the kernels of a step, on tensors at fixed addresses, so that CUDA graphs can hold it."""

    def __init__(
        self, config: SlamConfig, layout: GpuLayout, copy: ParameterCopy, space: GpuWorkSpace
    ) -> None:
        """`copy`: the parameters that are stepped; `space`: inputs, results and all between."""
        self._config = config
        self._layout = layout
        self._copy = copy
        self._space = space

    def render(self) -> None:
        """Place samples and render them."""
        s, layout, params = self._space, self._layout, self._copy.params
        sampling, T = self._config.sampling, self._config.field.truncation_m
        place_samples(
            s.rays, s.ray_count.tensor, s.poses.tensor, s.jitter.tensor, sampling.free_samples,
            sampling.surface_samples, sampling.free_reach, sampling.surface_reach * T, s.z, s.points,
        )  # fmt: skip
        field_forward(params, layout, s.points, len(s.points), s.acts)
        render_forward(
            *self._samples(), s.z, self._log_beta(), s.weights, s.rendered_color, s.rendered_depth,
            s.opacity,
        )  # fmt: skip

    def learn(self, parts: StepParts) -> None:
        """Losses, gradients and Adam, after `render`."""
        s, c, layout = self._space, self._config, self._layout
        log_beta, terms, grad = self._log_beta(), s.terms.tensor, s.gradient
        terms.zero_()
        s.d_color.zero_()
        if parts.patch:
            patch_ssim_backward(
                s.rendered_color, s.rays.color, s.windows.tensor, s.window_count.tensor,
                s.window_weight, c.weights.patch, s.d_color, terms[PATCH],
            )  # fmt: skip
        beta = slice(layout.log_beta, layout.log_beta + 1)
        d_log_beta = grad.values[beta] if parts.update else terms[_PROBE]
        losses_backward(
            *self._samples(), s.z, log_beta, s.weights, s.rendered_color, s.rendered_depth,
            s.rays.color, s.rays.depth, s.ray_weight.tensor, s.loss_weight, c.field.truncation_m,
            s.d_color, s.ray_count.tensor, s.d_sdf, s.d_rgb, s.ray_loss.tensor, terms[TERMS],
            d_log_beta,
        )  # fmt: skip
        torch.sum(s.acts.inside, 0, keepdim=True, dtype=torch.int64, out=s.inside_count.tensor)
        if parts.update:
            self._backward_and_adam(parts)

    def _samples(self) -> tuple[Tensor, Tensor, Tensor]:
        """SDF [R, S], colour [R, S, 3] and `inside` [R, S] of all samples."""
        acts, (R, S) = self._space.acts, self._space.z.shape
        return acts.sdf.view(R, S), acts.rgb.view(R, S, 3), acts.inside.view(R, S)

    def _log_beta(self) -> Tensor:
        return self._copy.params[self._layout.log_beta : self._layout.log_beta + 1]

    def _backward_and_adam(self, parts: StepParts) -> None:
        s, c, layout, copy = self._space, self._config, self._layout, self._copy
        grad = s.gradient
        field_backward(
            copy.params, layout, len(s.points), s.acts, s.d_sdf.view(-1), s.d_rgb.view(-1, 3), grad,
            s.d_points, parts.poses,
        )  # fmt: skip
        if parts.poses:
            s.d_twist.tensor.zero_()
            pose_gradients(
                s.rays, s.ray_count.tensor, s.poses.tensor, s.z, s.d_points, s.d_twist.tensor
            )
        if parts.cube:
            smoothness_backward(
                copy.params, layout, s.cube.tensor, c.weights.smoothness, grad, s.feature,
                s.terms.tensor[SMOOTH],
            )  # fmt: skip
        chunk = layout.log_beta >> 4
        grad.touched[chunk : chunk + 1].fill_(1)
        sparse_adam(
            copy.params, copy.first_moment, copy.second_moment, grad, s.step.tensor, s.rates.tensor,
            ADAM_EPS, ADAM_BETA1, ADAM_BETA2, copy.stepped_at,
        )  # fmt: skip
