"""A part of a batch of rays on the CPU: one thread renders it and computes its losses and gradients."""

import numpy as np

from hsslam_node.kernels.field.activations import field_activations
from hsslam_node.kernels.field.backward import field_backward
from hsslam_node.kernels.field.forward import color_forward, geometry_forward
from hsslam_node.kernels.field.gradient import Gradient
from hsslam_node.kernels.field.layout import KernelLayout
from hsslam_node.kernels.field.pose_backward import field_pose_backward
from hsslam_node.kernels.mapping.ray_batch import place_samples, pose_gradients
from hsslam_node.kernels.mapping.rendering import (
    losses_backward,
    render_sums,
    rendering_weights,
    samples_with_color,
)
from hsslam_node.mapping.ray_batch import RayBatch
from hsslam_node.rendering.ray_sampling import SamplingPattern


class BatchPart:
    """Work space of one part, and its results for R rays."""

    def __init__(
        self, layout: KernelLayout, rays: int, sampling: SamplingPattern, truncation_m: float,
        free_sdf: float,
    ) -> None:  # fmt: skip
        S = sampling.count
        self._sampling = sampling
        self._truncation_m, self._free_sdf = truncation_m, free_sdf
        self._acts = field_activations(layout, rays * S)
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
        self.terms = np.zeros(5)  # of the losses, in the order of `losses_backward`
        self.d_log_beta = 0.0
        self._count = 0

    @property
    def color(self) -> np.ndarray:
        """Rendered colour [R, 3]."""
        return self._color[: self._count]

    @property
    def depth(self) -> np.ndarray:
        """Rendered depth [R], m."""
        return self._depth[: self._count]

    @property
    def ray_loss(self) -> np.ndarray:
        """Weighted loss of each ray [R]."""
        return self._ray_loss[: self._count]

    @property
    def inside(self) -> np.ndarray:
        """Which samples [R, S] uint8 are in the bound."""
        S = self._sampling.count
        return self._acts.inside[: self._count * S].reshape(-1, S)

    def render(
        self,
        params: np.ndarray,
        layout: KernelLayout,
        rays: RayBatch,
        matrices: np.ndarray,
        jitter: np.ndarray,
        least_color_weight: float,
    ) -> None:
        """Render R rays from poses `matrices` [slots, 3, 4] float32; jitter [R, S] places their samples.

        Samples whose rendering weight is below `least_color_weight` are grey.
        """
        R, s, acts = len(rays.depth), self._sampling, self._acts
        n = R * s.count
        self._count, self._rays, self._matrices = R, rays, matrices
        z, points, weights = self._z[:R], self._points[:n], self._weights[:R]
        place_samples(
            rays, R, matrices, jitter, s.free_samples, s.surface_samples, np.float32(s.free_reach),
            np.float32(s.surface_reach * self._truncation_m), z, points,
        )  # fmt: skip
        geometry_forward(params, layout, points, n, acts)
        self._beta = float(np.exp(params[layout.log_beta]))
        rendering_weights(acts.sdf[:n].reshape(z.shape), self.inside, self._beta, weights)
        with_color = samples_with_color(weights, np.float32(least_color_weight), acts.color_row)
        color_forward(params, layout, n, with_color, acts)
        rgb = acts.rgb[:n].reshape(R, -1, 3)
        render_sums(rgb, z, weights, self.color, self.depth, self._opacity[:R])

    def judge(
        self,
        loss_weight: np.ndarray,
        color: np.ndarray,
        depth: np.ndarray,
        ray_weight: np.ndarray,
        d_color: np.ndarray,
        batch: tuple[int, int],
    ) -> None:
        """Compute losses of the rendered rays against `color` [R, 3] and `depth` [R]; see `losses_backward`.

        `d_color` [R, 3]: gradient of other losses; `batch`: its numbers of rays and of rays with depth.
        """
        R, acts = self._count, self._acts
        z = self._z[:R]
        n = z.size
        self.d_log_beta = losses_backward(
            acts.sdf[:n].reshape(z.shape), acts.rgb[:n].reshape(R, -1, 3), self.inside, z,
            self._beta, self._weights[:R], self.color, self.depth, color, depth, ray_weight,
            loss_weight, self._truncation_m, self._free_sdf, d_color, *batch, self._d_sdf[:R],
            self._d_rgb[:R], self.ray_loss, self.terms,
        )  # fmt: skip

    def backward(
        self, params: np.ndarray, layout: KernelLayout, grad: Gradient, with_poses: bool
    ) -> np.ndarray:
        """Add the gradient by the parameters to `grad`; return that by the poses [slots, 6], or zeros."""
        R, n = self._count, self._count * self._sampling.count
        d_sdf, d_rgb = self._d_sdf[:R].reshape(n), self._d_rgb[:R].reshape(n, 3)
        field_backward(
            params, layout, n, self._acts, d_sdf, d_rgb, grad, self._d_points, with_poses
        )  # fmt: skip
        return self._d_twist() if with_poses else np.zeros((len(self._matrices), 6), np.float32)

    def pose_backward(self, params: np.ndarray, layout: KernelLayout) -> np.ndarray:
        """Return only the gradient by the poses, [slots, 6]."""
        R, n = self._count, self._count * self._sampling.count
        d_sdf, d_rgb = self._d_sdf[:R].reshape(n), self._d_rgb[:R].reshape(n, 3)
        field_pose_backward(params, layout, n, self._acts, d_sdf, d_rgb, self._d_points)
        return self._d_twist()

    def _d_twist(self) -> np.ndarray:
        R, d_twist = self._count, np.zeros((len(self._matrices), 6), np.float32)
        pose_gradients(self._rays, R, self._matrices, self._z[:R], self._d_points, d_twist)
        return d_twist


def batch_parts(rays: int, parts: int) -> list[slice]:
    """The rays of each part of a batch; sizes differ by one at most."""
    return [slice(rays * k // parts, rays * (k + 1) // parts) for k in range(parts)]
