"""One optimisation step of the scene model over a batch of rays; mapping and BA share it."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np

from hsslam_node.config import SlamConfig
from hsslam_node.device.threads import Threads
from hsslam_node.errors import OutOfMemoryError
from hsslam_node.kernels.field.gradient import Gradient, add_gradient, gradient, touch_range
from hsslam_node.kernels.field.layout import kernel_layout, levels_of
from hsslam_node.kernels.mapping.adam import sparse_adam
from hsslam_node.kernels.mapping.patch_ssim import patch_ssim_backward
from hsslam_node.kernels.mapping.smoothness import smoothness_backward
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.batch_part import BatchPart, batch_parts
from hsslam_node.mapping.ray_batch import RayBatch, RayDraw, place_blind_rays, ray_batch
from hsslam_node.mapping.ray_need import RayNeed
from hsslam_node.mapping.step_inputs import (
    keyframe_losses,
    learning_rates,
    patch_windows,
    ray_weights,
    smoothness_cube,
    window_weights,
)

T = TypeVar("T")
ADAM_EPS, ADAM_BETA1, ADAM_BETA2 = 1e-15, 0.9, 0.99


@dataclass(frozen=True)
class StepReport:
    """Report of one step."""

    rays: int
    outside: int  # samples outside the bound, masked out of every loss
    loss: float  # weighted sum of all terms
    keyframe_loss: np.ndarray  # [n] see `keyframe_losses`; without patch and smoothness
    pose_gradient: np.ndarray  # [n, 6] by a world-side twist of each pose, or zeros


# [n, 4, 4], or a call that returns them; an optimiser calls it once, when it has drawn the rays
Poses = np.ndarray | Callable[[], np.ndarray]


class MapOptimiser:
    """Forward, losses, backward and Adam over the parameters, with private work space.

    It computes a batch in `mapper.parts` parts, each with its own work space and gradient, on up to
    `threads` threads; the result does not depend on `threads`.
    """

    reports_late = False

    def __init__(
        self, config: SlamConfig, parameters: FieldParameters, rays: int, threads: int = 1
    ) -> None:
        self._config = config
        self._parameters = parameters
        self._field = parameters.layout
        self._layout = kernel_layout(self._field)
        self._gradients: list[Gradient] = []  # as large as the map: made by the first step
        self._draw = RayDraw(config.mapper, blind=config.weights.blind_color > 0)
        self._batch = ray_batch(rays)
        parts = config.mapper.parts
        w, T = config.weights, config.field.truncation_m
        self._parts = [
            BatchPart(self._layout, -(-rays // parts), config.sampling, T, w.free_sdf)
            for _ in range(parts)
        ]
        self._threads = Threads(threads)
        self._loss_weight = np.array(
            [w.color, w.depth, w.sdf_middle, w.sdf_tail, w.free_space], np.float32
        )
        self._window_weight = (
            window_weights(config.mapper.patch_kernel_px).numpy().astype(np.float32).ravel()
        )

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
        """One iteration over `counts` [n] rays of `keyframes` [n] seen from `poses`.

        `with_poses`: also compute the pose gradient. `update` False: step nothing (a probe). `need`: draw
        pixels by it, else uniformly.
        """
        self._follow()
        config, parts = self._config, self._parts
        R = self._draw.fill(self._batch, store, keyframes, counts, generator, need)
        poses = poses() if callable(poses) else poses
        if R == 0:
            return StepReport(0, 0, 0.0, np.zeros(len(keyframes)), np.zeros((len(keyframes), 6)))
        S, batch = config.sampling.count, self._batch.part(slice(R))
        place_blind_rays(batch, poses, self._field.bound)
        matrices = np.ascontiguousarray(poses[:, :3], np.float32)
        jitter = generator.random((R, S), np.float32)
        params, layout, spans = self._parameters.params, self._layout, batch_parts(R, len(parts))
        least = config.mapper.least_color_weight

        def render(k: int) -> None:
            rows = spans[k]
            parts[k].render(params, layout, batch.part(rows), matrices, jitter[rows], least)

        self._in_parallel(render)
        d_color = np.zeros((R, 3), np.float32)
        patch = 0.0
        if update and config.weights.patch > 0:
            patch = self._patch_term(batch, d_color, generator)
        weight = ray_weights(batch.depth, config.mapper, config.weights.blind_color)
        counted = R, int(np.count_nonzero(batch.depth > 0))

        def judge(k: int) -> None:
            rows = spans[k]
            parts[k].judge(
                self._loss_weight, batch.color[rows], batch.depth[rows], weight[rows], d_color[rows],
                counted,
            )  # fmt: skip

        d_twist = np.zeros((len(keyframes), 6), np.float32)
        smooth = 0.0
        if not update:
            self._in_parallel(judge)
        else:
            gradients = self._own_gradients()
            grad = gradients[0]

            def backward(k: int) -> np.ndarray:
                judge(k)
                return parts[k].backward(params, layout, gradients[k], with_poses)

            with self._parameters.stepping(grad.values, grad.touched):
                d_twist = np.sum(self._in_parallel(backward), axis=0)
                smooth = self._smoothness_term(generator, grad)
                grad.values[layout.log_beta] += sum(part.d_log_beta for part in parts)
                touch_range(grad, layout.log_beta, layout.log_beta + 1)
                self._adam(gradients, rate_factor)
        terms = np.sum([part.terms for part in parts], axis=0)
        ray_loss = np.concatenate([part.ray_loss for part in parts])
        per_keyframe = keyframe_losses(ray_loss, batch.slot, batch.depth, len(keyframes))
        loss = float(terms @ self._loss_weight) + config.weights.patch * patch + smooth
        outside = R * S - sum(int(np.count_nonzero(part.inside)) for part in parts)
        return StepReport(R, outside, loss, per_keyframe, d_twist.astype(np.float64))

    def push(self) -> None:
        """Do nothing: `step` changes the parameters in host memory."""

    def _follow(self) -> None:
        """Adopt the current bound: the map may have grown since the last step."""
        self._parameters.follow()
        if self._field is not self._parameters.layout:
            self._field = self._parameters.layout
            self._layout = kernel_layout(self._field)
            self._gradients = []

    def _in_parallel(self, work: Callable[[int], T]) -> list[T]:
        """Run `work` for each part; return the results."""
        return self._threads.run([partial(work, k) for k in range(len(self._parts))])

    def _own_gradients(self) -> list[Gradient]:
        """One for each part. All processes that step the map share the first (private if memory is short);
        the others are private."""
        if not self._gradients:
            try:
                first = gradient(self._layout, *self._parameters.gradient_arrays())
            except OutOfMemoryError:
                first = gradient(self._layout)
            self._gradients = [first, *(gradient(self._layout) for _ in self._parts[1:])]
        return self._gradients

    def _patch_term(
        self, batch: RayBatch, d_color: np.ndarray, generator: np.random.Generator
    ) -> float:
        windows = patch_windows(len(d_color), self._config.mapper, generator)
        if len(windows) == 0:
            return 0.0
        color = np.concatenate([part.color for part in self._parts])
        return patch_ssim_backward(
            color, batch.color, windows, self._window_weight, self._config.weights.patch, d_color
        )

    def _smoothness_term(self, generator: np.random.Generator, grad: Gradient) -> float:
        m, weight = self._config.mapper, self._config.weights.smoothness
        if weight == 0 or self._parameters.step % m.smoothness_every:
            return 0.0
        cube = smoothness_cube(
            self._parameters.layout.bound, m.smoothness_vertices, m.smoothness_cell_m, generator
        )
        levels = batch_parts(len(self._layout.hash_offset), len(self._parts))

        def pull(k: int) -> float:  # levels share nothing
            layout = levels_of(self._layout, levels[k])
            return smoothness_backward(self._parameters.params, layout, cube, weight, grad)

        return weight * sum(self._in_parallel(pull))

    def _adam(self, gradients: list[Gradient], factor: float) -> None:
        p, parts = self._parameters, len(self._parts)
        rates = learning_rates(p.layout, self._config.mapper, factor)
        step = p.count_step()

        def move(k: int) -> None:
            for other in gradients[1:]:
                add_gradient(gradients[0], other, k, parts)
            sparse_adam(
                p.params, p.first_moment, p.second_moment, gradients[0], step, rates,
                ADAM_EPS, ADAM_BETA1, ADAM_BETA2, p.stepped_at, p.page_stepped_at, k, parts,
            )  # fmt: skip

        self._in_parallel(move)
