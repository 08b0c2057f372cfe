"""The objective of tracking by rendering, on a GPU."""

import numpy as np
import torch
from torch import Tensor

from hsslam_node.config import SlamConfig
from hsslam_node.device.graph_cache import GraphCache
from hsslam_node.device.staged_array import StagedArray
from hsslam_node.frame import Frame
from hsslam_node.gpu_kernels.field.pose_backward import field_pose_backward
from hsslam_node.kernels.mapping.rendering import COLOR
from hsslam_node.mapping.gpu.batch import GpuBatch
from hsslam_node.tracking.map_view import MapView
from hsslam_node.tracking.rendering_objective import FrameRays


class GpuRenderingObjective:
    """A `PoseObjective`, twin of `RenderingObjective`: the same rays, drawn on the host.

    Everything between the inputs and the result of a call is one CUDA graph.
    """

    def __init__(self, config: SlamConfig, seed: int, view: MapView) -> None:
        assert view.on_device is not None
        self._map = view.on_device
        self._config = config.rendering_tracker
        self._frame_rays = FrameRays(config, seed)
        device, layout = self._map.device, self._map.layout
        self._graphs = GraphCache(device)
        R = self._config.pixels
        truncation_m = config.field.truncation_m
        # one pose, so all slots are 0
        free_sdf = config.weights.free_sdf
        self._batch = GpuBatch(layout, R, 1, config.sampling, truncation_m, free_sdf, device)
        self._result = StagedArray((7,), torch.float32, device)  # loss, gradient by the pose

        def zeros(*shape: int) -> Tensor:
            return torch.zeros(shape, dtype=torch.float32, device=device.tensors_on)

        self._index = torch.arange(R, device=device.tensors_on)
        self._no_extra, self._ones = zeros(R, 3), zeros(R) + 1.0
        self._terms, self._d_log_beta = zeros(5), zeros(1)
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
        self._batch.poses.host[0] = T_world_cam[:3]
        self._batch.poses.send()
        self._graphs.run("evaluate", self._evaluate)
        if self._config.fresh_pixels:
            self._frame_rays.draw()  # while the device works
        loss, *twist = self._result.fetch().astype(np.float64)
        if self._config.fresh_pixels:
            self._send()
        return float(loss), np.array(twist)

    def _send(self) -> None:
        """Send the drawn rays. No launch uses an earlier copy that is still under way."""
        drawn, R, b = self._frame_rays, self._frame_rays.count, self._batch
        for target, source in (
            (b.direction, drawn.rays.direction),
            (b.depth, drawn.rays.depth),
            (b.color, drawn.rays.color),
            (b.jitter, drawn.jitter),
        ):
            target.host[:R] = source[:R]
            target.send(R)
        b.ray_count.host[0] = R
        b.ray_count.send()

    def _evaluate(self) -> None:
        """Loss and gradient on the device: only launches, on tensors at fixed addresses."""
        params, layout, b = self._map.params, self._map.layout, self._batch
        b.render(params, layout)
        color, depth, loss_weight = self._without_outliers()
        b.judge(
            params, layout, loss_weight, color, depth, self._ones, self._no_extra, self._terms,
            self._d_log_beta,
        )  # fmt: skip
        field_pose_backward(params, layout, b.samples, b.acts, b.d_sdf, b.d_rgb, b.d_points)
        b.add_up_poses()
        self._result.tensor[0] = (self._terms * loss_weight).sum()
        self._result.tensor[1:] = b.d_twist.tensor[0]

    def _without_outliers(self) -> tuple[Tensor, Tensor, Tensor]:
        """As in `RenderingObjective`: an outlier gets its rendered colour, and no depth."""
        b = self._batch
        measured_color, measured_depth = b.color.tensor, b.depth.tensor
        if self._config.outlier_factor == 0:
            return measured_color, measured_depth, self._loss_weight
        count = b.ray_count.tensor
        is_ray = self._index < count
        error = (b.rendered_depth - measured_depth).abs()
        ascending = error.masked_fill(~is_ray, torch.inf).sort().values
        median = (ascending[(count - 1) // 2] + ascending[count // 2]) / 2
        outlier = is_ray & (error > self._config.outlier_factor * median)
        measured_color = torch.where(outlier[:, None], b.rendered_color, measured_color)
        measured_depth = torch.where(outlier, 0.0, measured_depth)
        loss_weight = self._loss_weight.clone()
        loss_weight[COLOR : COLOR + 1] *= count / (count - outlier.sum()).clamp(min=1)
        return measured_color, measured_depth, loss_weight
