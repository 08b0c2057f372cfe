"""The objective of tracking by rendering, on a GPU."""

import numpy as np
import torch
from torch import Tensor

from hsslam_node.config import SlamConfig
from hsslam_node.frame import Frame
from hsslam_node.gpu_kernels.field.activations import field_activations
from hsslam_node.gpu_kernels.field.forward import field_forward
from hsslam_node.gpu_kernels.field.pose_backward import field_pose_backward
from hsslam_node.gpu_kernels.mapping.losses import losses_backward
from hsslam_node.gpu_kernels.mapping.ray_batch import gpu_rays, place_samples, pose_gradients
from hsslam_node.gpu_kernels.mapping.rendering import render_forward
from hsslam_node.kernels.mapping.rendering import COLOR
from hsslam_node.tracking.map_view import MapView
from hsslam_node.tracking.rendering_objective import FrameRays


class GpuRenderingObjective:
    """A `PoseObjective`, twin of `RenderingObjective`: the same rays, drawn on the host."""

    def __init__(self, config: SlamConfig, seed: int, view: MapView) -> None:
        assert view.on_device is not None
        self._config, self._sampling = config.rendering_tracker, config.sampling
        self._truncation_m = config.field.truncation_m
        self._frame_rays = FrameRays(config, seed)
        layout = view.on_device.layout
        R, S = self._config.pixels, config.sampling.count

        def zeros(*shape: int) -> Tensor:
            return torch.zeros(shape, dtype=torch.float32, device=layout.device)

        self._rays = gpu_rays(R, layout.device)
        self._jitter = zeros(R, S)
        self._acts = field_activations(layout, R * S)
        self._points, self._d_points = zeros(R * S, 3), zeros(R * S, 3)
        self._z, self._weights, self._d_sdf = zeros(R, S), zeros(R, S), zeros(R, S)
        self._d_rgb = zeros(R, S, 3)
        self._color, self._depth, self._opacity = zeros(R, 3), zeros(R), zeros(R)
        self._ray_loss, self._no_extra, self._ones = zeros(R), zeros(R, 3), zeros(R) + 1.0
        self._terms, self._d_log_beta = zeros(5), zeros(1)
        c = self._config
        self._loss_weight = zeros(5)
        self._loss_weight[:] = torch.tensor(
            [c.color, c.depth, c.sdf_middle, c.sdf_tail, c.free_space]
        )

    def observe(self, frame: Frame, view: MapView) -> None:
        """Take this frame and this map."""
        assert view.on_device is not None
        self._map = view.on_device
        self._frame_rays.observe(frame)
        self._send()

    def __call__(self, T_world_cam: np.ndarray) -> tuple[float, np.ndarray]:
        """Loss and gradient [6], see `PoseObjective`; draws the pixels of the next call."""
        R = self._frame_rays.count
        if R == 0:
            return float("inf"), np.zeros(6)
        found = self._evaluate(T_world_cam, R)
        if self._config.fresh_pixels:
            self._frame_rays.draw()  # while the device works
        loss, *twist = found.cpu().numpy().astype(np.float64)
        if self._config.fresh_pixels:
            self._send()
        return float(loss), np.array(twist)

    def _send(self) -> None:
        host, R = self._frame_rays, self._frame_rays.count
        for target, source in (
            (self._rays.direction, host.rays.direction),
            (self._rays.depth, host.rays.depth),
            (self._rays.color, host.rays.color),
            (self._jitter, host.jitter),
        ):
            target[:R].copy_(torch.from_numpy(source[:R]))

    def _evaluate(self, T_world_cam: np.ndarray, R: int) -> Tensor:
        """Loss and gradient [7], still on the device."""
        params, layout, acts = self._map.params, self._map.layout, self._acts
        s, T, S = self._sampling, self._truncation_m, self._sampling.count
        device = layout.device
        count = torch.tensor([R], dtype=torch.int32, device=device)
        pose = torch.from_numpy(T_world_cam[None, :3].astype(np.float32)).to(device)
        z, weights, color, depth = (
            x[:R] for x in (self._z, self._weights, self._color, self._depth)
        )
        place_samples(
            self._rays, count, pose, self._jitter, s.free_samples, s.surface_samples, s.free_reach,
            s.surface_reach * T, z, self._points,
        )  # fmt: skip
        field_forward(params, layout, self._points, R * S, acts)
        sdf, rgb = acts.sdf[: R * S].view(R, S), acts.rgb[: R * S].view(R, S, 3)
        inside = acts.inside[: R * S].view(R, S)
        log_beta = params[layout.log_beta : layout.log_beta + 1]
        render_forward(sdf, rgb, inside, z, log_beta, weights, color, depth, self._opacity)
        measured_color, measured_depth, loss_weight = self._without_outliers(R, color, depth)
        losses_backward(
            sdf, rgb, inside, z, log_beta, weights, color, depth, measured_color, measured_depth,
            self._ones, loss_weight, T, self._no_extra, count, self._d_sdf, self._d_rgb,
            self._ray_loss, self._terms, self._d_log_beta,
        )  # fmt: skip
        field_pose_backward(
            params, layout, R * S, acts, self._d_sdf.view(-1), self._d_rgb.view(-1, 3),
            self._d_points,
        )  # fmt: skip
        d_twist = torch.zeros((1, 6), dtype=torch.float32, device=device)
        pose_gradients(self._rays, count, pose, z, self._d_points, d_twist)
        return torch.cat([(self._terms * loss_weight).sum(0, keepdim=True), d_twist[0]])

    def _without_outliers(
        self, R: int, color: Tensor, depth: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """As in `RenderingObjective`: an outlier gets its rendered colour, and no depth."""
        measured_color, measured_depth = self._rays.color[:R], self._rays.depth[:R]
        if self._config.outlier_factor == 0:
            return measured_color, measured_depth, self._loss_weight
        error = (depth - measured_depth).abs()
        outlier = error > self._config.outlier_factor * torch.quantile(error, 0.5)
        measured_color = torch.where(outlier[:, None], color, measured_color)
        measured_depth = torch.where(outlier, 0.0, measured_depth)
        loss_weight = self._loss_weight.clone()
        loss_weight[COLOR] *= R / (~outlier).sum().clamp(min=1)
        return measured_color, measured_depth, loss_weight
