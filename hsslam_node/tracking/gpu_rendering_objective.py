"""The objective of tracking by rendering, on a GPU."""

import numpy as np
import torch
from torch import Tensor

from hsslam_node.config import SlamConfig
from hsslam_node.device.graph_cache import GraphCache
from hsslam_node.device.staged_array import StagedArray
from hsslam_node.frame import Frame
from hsslam_node.gpu_kernels.field.activations import field_activations
from hsslam_node.gpu_kernels.field.forward import field_forward
from hsslam_node.gpu_kernels.field.pose_backward import field_pose_backward
from hsslam_node.gpu_kernels.mapping.losses import losses_backward
from hsslam_node.gpu_kernels.mapping.ray_batch import GpuRays, place_samples, pose_gradients
from hsslam_node.gpu_kernels.mapping.rendering import render_forward
from hsslam_node.kernels.mapping.rendering import COLOR
from hsslam_node.tracking.map_view import MapView
from hsslam_node.tracking.rendering_objective import FrameRays


class GpuRenderingObjective:
    """A `PoseObjective`, twin of `RenderingObjective`: the same rays, drawn on the host.

    Everything between the inputs and the result of a call is one CUDA graph. It always runs over all rays;
    `_count` is the number of valid ones.
    """

    def __init__(self, config: SlamConfig, seed: int, view: MapView) -> None:
        assert view.on_device is not None
        self._map = view.on_device
        self._config, self._sampling = config.rendering_tracker, config.sampling
        self._truncation_m = config.field.truncation_m
        self._frame_rays = FrameRays(config, seed)
        device, layout = self._map.device, self._map.layout
        self._graphs = GraphCache(device)
        R, S = self._config.pixels, config.sampling.count

        def staged(*shape: int, dtype: torch.dtype = torch.float32) -> StagedArray:
            return StagedArray(shape, dtype, device)

        def zeros(*shape: int, dtype: torch.dtype = torch.float32) -> Tensor:
            return torch.zeros(shape, dtype=dtype, device=device.tensors_on)

        self._direction, self._depth, self._color = staged(R, 3), staged(R), staged(R, 3)
        self._jitter = staged(R, S)
        self._pose, self._count = staged(1, 3, 4), staged(1, dtype=torch.int32)
        self._result = staged(7)  # loss, gradient by the pose
        slots = zeros(R, dtype=torch.int32)  # all 0: there is one pose
        self._rays = GpuRays(
            self._direction.tensor, self._depth.tensor, self._color.tensor, slots
        )  # fmt: skip
        self._index = torch.arange(R, device=device.tensors_on)
        self._acts = field_activations(layout, R * S)
        self._points, self._d_points = zeros(R * S, 3), zeros(R * S, 3)
        self._z, self._weights, self._d_sdf = zeros(R, S), zeros(R, S), zeros(R, S)
        self._d_rgb = zeros(R, S, 3)
        self._rendered_color, self._rendered_depth, self._opacity = zeros(R, 3), zeros(R), zeros(R)
        self._ray_loss, self._no_extra, self._ones = zeros(R), zeros(R, 3), zeros(R) + 1.0
        self._terms, self._d_log_beta, self._d_twist = zeros(5), zeros(1), zeros(1, 6)
        c = self._config
        self._loss_weight = zeros(5)
        self._loss_weight[:] = torch.tensor(
            [c.color, c.depth, c.sdf_middle, c.sdf_tail, c.free_space]
        )

    def observe(self, frame: Frame, view: MapView) -> None:
        """Take this frame and this map."""
        assert view.on_device is not None
        if view.on_device is not self._map:  # it has grown; graphs hold addresses
            self._map = view.on_device
            self._graphs = GraphCache(self._map.device)
        self._frame_rays.observe(frame)
        self._send()

    def __call__(self, T_world_cam: np.ndarray) -> tuple[float, np.ndarray]:
        """Loss and gradient [6], see `PoseObjective`; draws the pixels of the next call."""
        if self._frame_rays.count == 0:
            return float("inf"), np.zeros(6)
        self._pose.host[0] = T_world_cam[:3]
        self._pose.send()
        self._graphs.run("evaluate", self._evaluate)
        if self._config.fresh_pixels:
            self._frame_rays.draw()  # while the device works
        loss, *twist = self._result.fetch().astype(np.float64)
        if self._config.fresh_pixels:
            self._send()
        return float(loss), np.array(twist)

    def _send(self) -> None:
        """Send the drawn rays. No launch uses an earlier copy that is still under way."""
        drawn, R = self._frame_rays, self._frame_rays.count
        for target, source in (
            (self._direction, drawn.rays.direction),
            (self._depth, drawn.rays.depth),
            (self._color, drawn.rays.color),
            (self._jitter, drawn.jitter),
        ):
            target.host[:R] = source[:R]
            target.send(R)
        self._count.host[0] = R
        self._count.send()

    def _evaluate(self) -> None:
        """Loss and gradient on the device: only launches, on tensors at fixed addresses."""
        params, layout, acts = self._map.params, self._map.layout, self._acts
        s, T = self._sampling, self._truncation_m
        R, S = self._z.shape
        count, pose, z, weights = self._count.tensor, self._pose.tensor, self._z, self._weights
        color, depth = self._rendered_color, self._rendered_depth
        place_samples(
            self._rays, count, pose, self._jitter.tensor, s.free_samples, s.surface_samples,
            s.free_reach, s.surface_reach * T, z, self._points,
        )  # fmt: skip
        field_forward(params, layout, self._points, R * S, acts)
        sdf, rgb, inside = acts.sdf.view(R, S), acts.rgb.view(R, S, 3), acts.inside.view(R, S)
        log_beta = params[layout.log_beta : layout.log_beta + 1]
        render_forward(sdf, rgb, inside, z, log_beta, weights, color, depth, self._opacity)
        measured_color, measured_depth, loss_weight = self._without_outliers()
        losses_backward(
            sdf, rgb, inside, z, log_beta, weights, color, depth, measured_color, measured_depth,
            self._ones, loss_weight, T, self._no_extra, count, self._d_sdf, self._d_rgb,
            self._ray_loss, self._terms, self._d_log_beta,
        )  # fmt: skip
        field_pose_backward(
            params, layout, R * S, acts, self._d_sdf.view(-1), self._d_rgb.view(-1, 3),
            self._d_points,
        )  # fmt: skip
        self._d_twist.zero_()
        pose_gradients(self._rays, count, pose, z, self._d_points, self._d_twist)
        self._result.tensor[0] = (self._terms * loss_weight).sum()
        self._result.tensor[1:] = self._d_twist[0]

    def _without_outliers(self) -> tuple[Tensor, Tensor, Tensor]:
        """As in `RenderingObjective`: an outlier gets its rendered colour, and no depth."""
        measured_color, measured_depth = self._rays.color, self._rays.depth
        if self._config.outlier_factor == 0:
            return measured_color, measured_depth, self._loss_weight
        count, color = self._count.tensor, self._rendered_color
        is_ray = self._index < count
        error = (self._rendered_depth - measured_depth).abs()
        ascending = error.masked_fill(~is_ray, torch.inf).sort().values
        median = (ascending[(count - 1) // 2] + ascending[count // 2]) / 2
        outlier = is_ray & (error > self._config.outlier_factor * median)
        measured_color = torch.where(outlier[:, None], color, measured_color)
        measured_depth = torch.where(outlier, 0.0, measured_depth)
        loss_weight = self._loss_weight.clone()
        loss_weight[COLOR : COLOR + 1] *= count / (count - outlier.sum()).clamp(min=1)
        return measured_color, measured_depth, loss_weight
