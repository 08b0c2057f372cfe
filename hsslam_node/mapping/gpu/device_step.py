"""A mapping step on the device: which kernels it launches, in which order."""

from typing import NamedTuple

import torch

from hsslam_node.config import SlamConfig
from hsslam_node.device.parameter_copy import ParameterCopy
from hsslam_node.gpu_kernels.field.backward import field_backward
from hsslam_node.gpu_kernels.field.layout import GpuLayout
from hsslam_node.gpu_kernels.mapping.adam import sparse_adam
from hsslam_node.gpu_kernels.mapping.patch_ssim import patch_ssim_backward
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
        self._space.batch.render(self._copy.params, self._layout)

    def learn(self, parts: StepParts) -> None:
        """Losses, gradients and Adam, after `render`."""
        s, b, c, layout = self._space, self._space.batch, self._config, self._layout
        terms, grad = s.terms.tensor, s.gradient
        terms.zero_()
        s.d_color.zero_()
        if parts.patch:
            patch_ssim_backward(
                b.rendered_color, b.color.tensor, s.windows.tensor, s.window_count.tensor,
                s.window_weight, c.weights.patch, s.d_color, terms[PATCH],
            )  # fmt: skip
        beta = slice(layout.log_beta, layout.log_beta + 1)
        d_log_beta = grad.values[beta] if parts.update else terms[_PROBE]
        b.judge(
            self._copy.params, layout, s.loss_weight, b.color.tensor, b.depth.tensor,
            s.ray_weight.tensor, s.d_color, terms[TERMS], d_log_beta,
        )  # fmt: skip
        torch.sum(b.acts.inside, 0, keepdim=True, dtype=torch.int64, out=s.inside_count.tensor)
        if parts.update:
            self._backward_and_adam(parts)

    def _backward_and_adam(self, parts: StepParts) -> None:
        s, c, layout, copy = self._space, self._config, self._layout, self._copy
        b, grad = s.batch, s.gradient
        field_backward(
            copy.params, layout, b.samples, b.acts, b.d_sdf, b.d_rgb, grad, b.d_points, parts.poses
        )
        if parts.poses:
            b.add_up_poses()
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
