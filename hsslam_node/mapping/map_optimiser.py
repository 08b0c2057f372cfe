"""One optimisation step of the scene model over a batch of rays; mapping and BA share it."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.config import SlamConfig
from hsslam_node.errors import OutOfMemoryError
from hsslam_node.kernels.field.activations import field_activations
from hsslam_node.kernels.field.backward import field_backward
from hsslam_node.kernels.field.forward import color_forward, geometry_forward
from hsslam_node.kernels.field.gradient import Gradient, gradient, touch_range
from hsslam_node.kernels.field.layout import kernel_layout
from hsslam_node.kernels.mapping.adam import sparse_adam
from hsslam_node.kernels.mapping.patch_ssim import patch_ssim_backward
from hsslam_node.kernels.mapping.ray_batch import place_samples, pose_gradients
from hsslam_node.kernels.mapping.rendering import (
    losses_backward,
    render_sums,
    rendering_weights,
    samples_with_color,
)
from hsslam_node.kernels.mapping.smoothness import smoothness_backward
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.ray_batch import RayDraw, ray_batch
from hsslam_node.mapping.ray_need import RayNeed
from hsslam_node.mapping.step_inputs import (
    learning_rates,
    patch_windows,
    ray_weights,
    smoothness_cube,
    window_weights,
)

ADAM_EPS, ADAM_BETA1, ADAM_BETA2 = 1e-15, 0.9, 0.99


@dataclass(frozen=True)
class StepReport:
    """What one step saw."""

    rays: int
    outside: int  # samples outside the bound, masked out of every loss
    loss: float  # weighted sum of all terms
    keyframe_loss: np.ndarray  # [n] mean weighted ray loss of each (no patch, no smoothness)
    pose_gradient: np.ndarray  # [n, 6] by a world-side twist of each pose; zeros unless asked for


class MapOptimiser:
    """Forward, losses, backward and Adam over the parameters, with private work space."""

    def __init__(self, config: SlamConfig, parameters: FieldParameters, rays: int) -> None:
        self._config = config
        self._parameters = parameters
        self._field = parameters.layout
        self._layout = kernel_layout(self._field)
        self._gradient: Gradient | None = None  # as large as the map: for who steps it
        self._rays = rays
        self._draw = RayDraw(config.mapper)
        S = config.sampling.count
        self._batch = ray_batch(rays)
        self._acts = field_activations(self._layout, rays * S)
        self._points = np.zeros((rays * S, 3), np.float32)
        self._d_points = np.zeros((rays * S, 3), np.float32)
        self._z = np.zeros((rays, S), np.float32)
        self._weights = np.zeros((rays, S), np.float32)
        self._d_sdf = np.zeros((rays, S), np.float32)
        self._d_rgb = np.zeros((rays, S, 3), np.float32)
        self._color = np.zeros((rays, 3), np.float32)
        self._depth = np.zeros(rays, np.float32)
        self._opacity = np.zeros(rays, np.float32)
        self._ray_loss = np.zeros(rays, np.float32)
        w = config.weights
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
        poses: np.ndarray,
        generator: np.random.Generator,
        *,
        rate_factor: float = 1.0,
        with_poses: bool = False,
        update: bool = True,
        need: RayNeed | None = None,
    ) -> StepReport:
        """One iteration over `counts` [n] rays of `keyframes` [n] seen from `poses` [n, 4, 4].

        `with_poses` also computes the pose gradient; without `update` nothing is stepped (a probe);
        `need`: where the rays go, else anywhere.
        """
        self._follow()
        m, sampling = self._config.mapper, self._config.sampling
        R = self._draw.fill(self._batch, store, keyframes, counts, generator, need)
        if R == 0:
            return StepReport(0, 0, 0.0, np.zeros(len(keyframes)), np.zeros((len(keyframes), 6)))
        S = sampling.count
        T = self._config.field.truncation_m
        matrices = np.ascontiguousarray(poses[:, :3], np.float32)
        jitter = generator.random((R, S), np.float32)
        z, points = self._z[:R], self._points[: R * S]
        place_samples(
            self._batch, R, matrices, jitter, sampling.free_samples, sampling.surface_samples,
            np.float32(sampling.free_reach), np.float32(sampling.surface_reach * T), z, points,
        )  # fmt: skip
        params, acts = self._parameters.params, self._acts
        geometry_forward(params, self._layout, points, R * S, acts)
        sdf = acts.sdf[: R * S].reshape(R, S)
        rgb = acts.rgb[: R * S].reshape(R, S, 3)
        inside = acts.inside[: R * S].reshape(R, S)
        beta = float(np.exp(params[self._layout.log_beta]))
        weights, color, depth = self._weights[:R], self._color[:R], self._depth[:R]
        rendering_weights(sdf, inside, beta, weights)
        with_color = samples_with_color(weights, np.float32(m.least_color_weight), acts.color_row)
        color_forward(params, self._layout, R * S, with_color, acts)
        render_sums(rgb, z, weights, color, depth, self._opacity[:R])

        d_color = np.zeros((R, 3), np.float32)
        patch = 0.0
        if update and self._config.weights.patch > 0:
            patch = self._patch_term(R, d_color, generator)
        terms = np.zeros(5)
        ray_weight = ray_weights(self._batch.depth[:R], m)
        d_log_beta = losses_backward(
            sdf, rgb, inside, z, beta, weights, color, depth, self._batch.color[:R],
            self._batch.depth[:R], ray_weight, self._loss_weight, T, d_color,
            self._d_sdf[:R], self._d_rgb[:R], self._ray_loss[:R], terms,
        )  # fmt: skip
        d_twist = np.zeros((len(keyframes), 6), np.float32)
        smooth = 0.0
        if update:
            grad = self._own_gradient()
            with self._parameters.stepping(grad.values, grad.touched):
                field_backward(
                    params, self._layout, R * S, acts, self._d_sdf[:R].reshape(-1),
                    self._d_rgb[:R].reshape(-1, 3), grad, self._d_points, with_poses,
                )  # fmt: skip
                if with_poses:
                    pose_gradients(self._batch, R, matrices, z, self._d_points, d_twist)
                smooth = self._smoothness_term(generator, grad)
                grad.values[self._layout.log_beta] += d_log_beta
                touch_range(grad, self._layout.log_beta, self._layout.log_beta + 1)
                self._adam(grad, rate_factor)
        slot = self._batch.slot[:R]
        n = np.maximum(np.bincount(slot, minlength=len(keyframes)), 1)
        per_keyframe = np.bincount(slot, self._ray_loss[:R], minlength=len(keyframes)) / n
        loss = float(terms @ self._loss_weight) + self._config.weights.patch * patch + smooth
        outside = R * S - int(np.count_nonzero(inside))
        return StepReport(R, outside, loss, per_keyframe, d_twist.astype(np.float64))

    def push(self) -> None:
        """Nothing: the parameters in host memory are the ones that are stepped."""

    def _follow(self) -> None:
        """Go on over the bound of now: the map may have grown since the last step."""
        self._parameters.follow()
        if self._field is not self._parameters.layout:
            self._field = self._parameters.layout
            self._layout = kernel_layout(self._field)
            self._gradient = None

    def _own_gradient(self) -> Gradient:
        """The gradient that all who step the map share; one of its own if memory is short."""
        if self._gradient is None:
            try:
                self._gradient = gradient(self._layout, *self._parameters.gradient_arrays())
            except OutOfMemoryError:
                self._gradient = gradient(self._layout)
        return self._gradient

    def _patch_term(self, R: int, d_color: np.ndarray, generator: np.random.Generator) -> float:
        windows = patch_windows(R, self._config.mapper, generator)
        if len(windows) == 0:
            return 0.0
        return patch_ssim_backward(
            self._color[:R], self._batch.color[:R], windows, self._window_weight,
            self._config.weights.patch, d_color,
        )  # fmt: skip

    def _smoothness_term(self, generator: np.random.Generator, grad: Gradient) -> float:
        m, weight = self._config.mapper, self._config.weights.smoothness
        if weight == 0 or self._parameters.step % m.smoothness_every:
            return 0.0
        cube = smoothness_cube(
            self._parameters.layout.bound, m.smoothness_vertices, m.smoothness_cell_m, generator
        )
        return weight * smoothness_backward(
            self._parameters.params, self._layout, cube, weight, grad
        )

    def _adam(self, grad: Gradient, factor: float) -> None:
        p = self._parameters
        rates = learning_rates(p.layout, self._config.mapper, factor)
        sparse_adam(
            p.params, p.first_moment, p.second_moment, grad, p.count_step(), rates,
            ADAM_EPS, ADAM_BETA1, ADAM_BETA2, p.stepped_at, p.page_stepped_at,
        )  # fmt: skip
