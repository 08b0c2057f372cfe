"""Rendering losses of a frame as a function of its pose, on the CPU, and Adam on that pose."""

from collections.abc import Callable
from functools import partial
from typing import Protocol, TypeVar

import numpy as np

from hsslam_node.config import RenderingTrackerConfig, SlamConfig
from hsslam_node.device.threads import Threads
from hsslam_node.frame import Frame
from hsslam_node.geometry.pose_adam import PoseAdam
from hsslam_node.geometry.se3 import moved_about_camera
from hsslam_node.kernels.mapping.ray_batch import gather_pixels
from hsslam_node.kernels.mapping.rendering import COLOR
from hsslam_node.mapping.batch_part import BatchPart, batch_parts
from hsslam_node.mapping.ray_batch import ray_batch
from hsslam_node.tracking.map_view import MapView

T = TypeVar("T")

_CANDIDATES = 3  # pixels drawn for each ray, as some have no depth
_PARTS = 2  # parts of a batch, for two threads


class FrameRays:
    """Rays through random pixels that have depth; the choice depends on seed and frame index alone."""

    def __init__(self, config: SlamConfig, seed: int) -> None:
        self._config = config.rendering_tracker
        self._max_depth_m = config.mapper.max_depth_m
        self._seed = seed
        self.rays = ray_batch(self._config.pixels)  # the first `count` are filled; slot 0
        self.count = 0
        self.jitter = np.zeros((self._config.pixels, config.sampling.count), np.float32)  # 0..1

    def observe(self, frame: Frame) -> None:
        """Take this frame and draw its pixels."""
        self._frame = frame
        self._generator = np.random.default_rng((self._seed, frame.index, 13))
        self.draw()

    def draw(self) -> None:
        """Draw pixels of the frame, and the jitter of the samples on their rays."""
        frame, camera, c = self._frame, self._frame.camera, self._config
        border = min(round(c.border * camera.width_px), 2 * camera.height_px // 5)
        uv = self._generator.integers(
            (border, border),
            (camera.width_px - border, camera.height_px - border),
            (_CANDIDATES * c.pixels, 2),
        )
        K = np.array([camera.fx, camera.fy, camera.cx, camera.cy], np.float32)
        self.count = gather_pixels(
            frame.color, frame.depth_raw, 1.0 / frame.depth_units_per_m, self._max_depth_m, K, uv,
            0, 0.0, False, 0, self.rays, 0, c.pixels,
        )  # fmt: skip
        self._generator.random(out=self.jitter[: self.count], dtype=np.float32)


class RenderingObjective:
    """Colour, depth, SDF and free-space losses of rays through random pixels that have depth.

    A `PoseObjective`. If `fresh_pixels` is off, pixels and sample depths stay the same for a frame, so
    the loss is a smooth function of the pose.
    """

    def __init__(self, config: SlamConfig, seed: int, threads: int = 1) -> None:
        """`threads`: number of threads, of which two are used; the result does not depend on it."""
        self._slam = config
        self._config = config.rendering_tracker
        self._frame_rays = FrameRays(config, seed)
        self._rays = self._frame_rays.rays
        self._parts: list[BatchPart] = []
        self._threads = Threads(threads)
        c = self._config
        self._loss_weight = np.array(
            [c.color, c.depth, c.sdf_middle, c.sdf_tail, c.free_space], np.float32
        )

    def observe(self, frame: Frame, view: MapView) -> None:
        """Take this frame and this map."""
        self._view = view
        if not self._parts:
            rays = -(-self._config.pixels // _PARTS)
            sampling, T = self._slam.sampling, self._slam.field.truncation_m
            free_sdf = self._slam.weights.free_sdf
            self._parts = [
                BatchPart(view.layout, rays, sampling, T, free_sdf) for _ in range(_PARTS)
            ]
        self._frame_rays.observe(frame)

    def __call__(self, T_world_cam: np.ndarray) -> tuple[float, np.ndarray]:
        """Loss and gradient [6], see `PoseObjective`; draws the pixels of the next call."""
        R = self._frame_rays.count
        if R == 0:
            return float("inf"), np.zeros(6)
        loss, gradient = self._evaluate(T_world_cam, R)
        if self._config.fresh_pixels:
            self._frame_rays.draw()
        return loss, gradient

    def _evaluate(self, T_world_cam: np.ndarray, R: int) -> tuple[float, np.ndarray]:
        params, layout, parts = self._view.params, self._view.layout, self._parts
        matrices = np.ascontiguousarray(T_world_cam[None, :3], np.float32)
        spans, jitter = batch_parts(R, len(parts)), self._frame_rays.jitter
        least = self._slam.mapper.least_color_weight

        def render(k: int) -> None:
            rows = spans[k]
            parts[k].render(params, layout, self._rays.part(rows), matrices, jitter[rows], least)

        self._at_once(render)
        color, depth = (
            np.concatenate([getattr(part, name) for part in parts]) for name in ("color", "depth")
        )
        measured_color, measured_depth, loss_weight = self._without_outliers(R, color, depth)
        d_color, weight = np.zeros((R, 3), np.float32), np.ones(R, np.float32)
        counted = R, int(np.count_nonzero(measured_depth > 0))

        def backward(k: int) -> np.ndarray:
            rows = spans[k]
            parts[k].judge(
                loss_weight, measured_color[rows], measured_depth[rows], weight[rows], d_color[rows],
                counted,
            )  # fmt: skip
            return parts[k].pose_backward(params, layout)

        d_twist = np.sum(self._at_once(backward), axis=0)
        terms = np.sum([part.terms for part in parts], axis=0)
        return float(terms @ loss_weight), d_twist[0].astype(np.float64)

    def _at_once(self, work: Callable[[int], T]) -> list[T]:
        return self._threads.run([partial(work, k) for k in range(len(self._parts))])

    def _without_outliers(
        self, R: int, color: np.ndarray, depth: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Measured colour, measured depth and loss weights without outliers.

        An outlier gets its rendered colour and no depth; the weight of colour makes up for fewer rays.
        """
        measured_color, measured_depth = self._rays.color[:R], self._rays.depth[:R]
        if self._config.outlier_factor == 0:
            return measured_color, measured_depth, self._loss_weight
        error = np.abs(depth - measured_depth)
        outlier = error > self._config.outlier_factor * np.median(error)
        measured_color = np.where(outlier[:, None], color, measured_color)
        measured_depth = np.where(outlier, np.float32(0.0), measured_depth)
        loss_weight = self._loss_weight.copy()
        loss_weight[COLOR] *= R / max(R - np.count_nonzero(outlier), 1)
        return measured_color, measured_depth, loss_weight


class PoseObjective(Protocol):
    """A loss of the camera pose of one frame in one map."""

    def observe(self, frame: Frame, view: MapView) -> None:
        """Take this frame and this map."""
        ...

    def __call__(self, T_world_cam: np.ndarray) -> tuple[float, np.ndarray]:
        """The loss at T_world_cam [4, 4] and its gradient [6] (1/m, 1/rad) for a twist of the pose:
        translation in world axes, rotation in world axes about the camera's centre.

        The loss is infinite and the gradient zero if no pixel can be rendered.
        """
        ...


def descend(
    objective: PoseObjective, T_world_cam: np.ndarray, config: RenderingTrackerConfig
) -> np.ndarray:
    """Descend from T_world_cam [4, 4] with Adam, then settle from the visited pose with the smallest loss.

    The losses of fresh pixels differ by chance, so the best of a few poses is as far off as a step is long;
    shorter steps average the pixels.
    """
    adam = PoseAdam(config.adam_beta1)
    rates = np.array([config.translation_rate] * 3 + [config.rotation_rate] * 3)
    T, best, least = T_world_cam, T_world_cam, float("inf")
    for _ in range(config.iterations):
        loss, gradient = objective(T)
        if loss < least:
            best, least = T, loss
        T = moved_about_camera(T, adam.step(gradient, rates))
    for _ in range(config.settling_iterations):
        rates = 0.5 * rates
        _, gradient = objective(best)
        best = moved_about_camera(best, adam.step(gradient, rates))
    return best
