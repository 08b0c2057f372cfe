"""The optimiser of the scene model on the GPU: twin of `MapOptimiser`, with the same random numbers."""

from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
import torch

from hsslam_node.config import SlamConfig
from hsslam_node.device.device import Device
from hsslam_node.device.graph_cache import GraphCache
from hsslam_node.device.parameter_copy import ParameterCopy
from hsslam_node.gpu_kernels.field.layout import gpu_layout
from hsslam_node.kernels.field.layout import kernel_layout
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.gpu.device_step import PATCH, SMOOTH, TERMS, DeviceStep, StepParts
from hsslam_node.mapping.gpu.work_space import GpuWorkSpace
from hsslam_node.mapping.map_optimiser import Poses, StepReport
from hsslam_node.mapping.ray_batch import RayDraw, place_blind_rays
from hsslam_node.mapping.ray_need import RayNeed
from hsslam_node.mapping.step_inputs import (
    keyframe_losses,
    learning_rates,
    patch_windows,
    ray_weights,
    smoothness_cube,
)

# samples of a step; an H200 has done fewer before the host has drawn the next, see docs/performance.md
_LATE_FROM = 50_000


class LateReport(StepReport):
    """A report that is still on the device; the first look at it fetches it."""

    def __init__(self, fetch: Callable[[], StepReport]) -> None:
        object.__setattr__(self, "_fetch", fetch)

    def __getattr__(self, name: str) -> Any:
        if name not in (known := [field.name for field in fields(StepReport)]):
            raise AttributeError(name)
        report = object.__getattribute__(self, "_fetch")()
        for field in known:
            object.__setattr__(self, field, getattr(report, field))
        object.__delattr__(self, "_fetch")
        return getattr(report, name)


class GpuMapOptimiser:
    """Steps a copy of the parameters on the device; the host draws rays, jitter and patches.

    See `Optimiser`. A step is two CUDA graphs, rendering and the rest. The host draws patches and cube while
    the device renders, and the rays of a large step while the device works on the step before.
    """

    def __init__(
        self, config: SlamConfig, parameters: FieldParameters, rays: int, device: Device
    ) -> None:
        self._config = config
        self._parameters = parameters
        self._rays = rays
        self._draw = RayDraw(config.mapper, blind=config.weights.blind_color > 0)
        self._device = device
        self.reports_late = rays * config.sampling.count >= _LATE_FROM
        self._sent = torch.cuda.Event() if device.kind == "cuda" else None  # all inputs
        self._last: StepReport | None = None
        self._open()

    def _open(self) -> None:
        """Create copy, graphs and work space for the current bound."""
        self._field = self._parameters.layout
        layout = gpu_layout(kernel_layout(self._field), self._device.tensors_on)
        self._copy = ParameterCopy(self._parameters, self._device)
        self._graphs = GraphCache(self._device)
        self._space = GpuWorkSpace(self._config, layout, self._rays, self._device)
        self._work = DeviceStep(self._config, layout, self._copy, self._space)

    def step(
        self,
        store: KeyframeStore,
        keyframes: np.ndarray,
        counts: np.ndarray,
        poses: Poses,
        generator: np.random.Generator,
        *,
        rate_factor: float = 1.0,
        with_poses: bool = False,
        update: bool = True,
        need: RayNeed | None = None,
    ) -> StepReport:
        """One iteration, as `MapOptimiser.step`; the caller holds the writer's lease."""
        self._parameters.follow()
        if self._field is not self._parameters.layout:  # the map has grown
            self._look_at_last()
            self._open()
        s, n = self._space, len(keyframes)
        if self._sent is not None:
            self._sent.synchronize()
        R = self._draw.fill(s.host_rays, store, keyframes, counts, generator, need)
        if R:
            generator.random(out=s.batch.jitter.host[:R], dtype=np.float32)
        poses = poses() if callable(poses) else poses
        self._look_at_last()
        if R == 0:
            return StepReport(0, 0, 0.0, np.zeros(n), np.zeros((n, 6)))
        self._send_rays(R, poses)
        self._copy.pull()
        self._graphs.run("render", self._work.render)
        parts = StepParts(
            update=update,
            poses=update and with_poses,
            patch=update and self._send_windows(R, generator),
            cube=update and self._send_cube(generator),
        )
        if update:
            self._send_rates(rate_factor)
        if self._sent is not None:
            self._sent.record()
        self._graphs.run(parts, lambda: self._work.learn(parts))
        slot, depth = s.host_rays.slot[:R].copy(), s.host_rays.depth[:R].copy()
        report = self._last = LateReport(lambda: self._report(slot, depth, n, parts))
        if not self.reports_late:
            self._look_at_last()
        return report

    def _look_at_last(self) -> None:
        """Fetch the report of the step before, if nothing has: the next step overwrites it."""
        if self._last is not None:
            _ = self._last.loss
            self._last = None

    def push(self) -> None:
        """Send the stepped parameters to host memory; call it under the lease, before its release."""
        self._copy.push()

    def _send_rays(self, R: int, poses: np.ndarray) -> None:
        s, b = self._space, self._space.batch
        b.ray_count.host[0] = R
        b.slot.host[:R] = s.host_rays.slot[:R]
        place_blind_rays(s.host_rays.part(slice(R)), poses, self._field.bound)
        weight = ray_weights(
            b.depth.host[:R], self._config.mapper, self._config.weights.blind_color
        )
        s.ray_weight.host[:R] = weight
        b.poses.host[: len(poses)] = poses[:, :3]
        for array in (b.direction, b.depth, b.color, b.slot, s.ray_weight, b.jitter):
            array.send(R)
        b.ray_count.send()
        b.poses.send()

    def _send_windows(self, R: int, generator: np.random.Generator) -> bool:
        """Send the windows of patches; return whether this step has the patch term."""
        s = self._space
        if self._config.weights.patch == 0:
            return False
        windows = patch_windows(R, self._config.mapper, generator)
        s.windows.host[: len(windows)] = windows
        s.window_count.host[0] = len(windows)
        s.windows.send(len(windows))
        s.window_count.send()
        return True

    def _send_cube(self, generator: np.random.Generator) -> bool:
        """Send the cube; return whether this step has the smoothness term."""
        m, p = self._config.mapper, self._parameters
        if self._config.weights.smoothness == 0 or p.step % m.smoothness_every:
            return False
        cube = smoothness_cube(
            p.layout.bound, m.smoothness_vertices, m.smoothness_cell_m, generator
        )
        self._space.cube.host[:] = cube
        self._space.cube.send()
        return True

    def _send_rates(self, factor: float) -> None:
        s = self._space
        s.step.host[0] = self._copy.count_step()
        s.rates.host[:] = learning_rates(self._parameters.layout, self._config.mapper, factor)
        s.step.send()
        s.rates.send()

    def _report(self, slot: np.ndarray, depth: np.ndarray, n: int, parts: StepParts) -> StepReport:
        """The report of a step over `n` keyframes; slot [R], depth [R] of its rays."""
        s, b, w, R = self._space, self._space.batch, self._config.weights, len(slot)
        terms = s.terms.fetch().astype(np.float64)
        per_keyframe = keyframe_losses(b.ray_loss.fetch(R), slot, depth, n)
        weight = np.array([w.color, w.depth, w.sdf_middle, w.sdf_tail, w.free_space])
        loss = float(terms[TERMS] @ weight)
        if parts.patch:
            loss += w.patch * float(terms[PATCH][0])
        if parts.cube:
            loss += w.smoothness * float(terms[SMOOTH][0])
        outside = R * self._config.sampling.count - int(s.inside_count.fetch()[0])
        twist = b.d_twist.fetch(n).astype(np.float64) if parts.poses else np.zeros((n, 6))
        return StepReport(R, outside, loss, per_keyframe, twist)
