"""Renders images of a map, on the CPU."""

import numpy as np

from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import pixel_rays
from hsslam_node.kernels.field.activations import FieldActivations, field_activations
from hsslam_node.kernels.field.forward import field_forward
from hsslam_node.kernels.field.layout import kernel_layout
from hsslam_node.kernels.mapping.rendering import render_forward
from hsslam_node.map.layout import FieldLayout
from hsslam_node.rendering.ray_sampling import SamplingPattern, sample_rays

_CHUNK_RAYS = 8192


class MapRenderer:
    """Volume rendering of a map of parameters [P], with the sampling pattern that it was trained with.

    The density is per sample, so the pattern is part of the model. Threads may call it at once.
    """

    def __init__(self, layout: FieldLayout, params: np.ndarray, sampling: SamplingPattern) -> None:
        self._params = params
        self._layout = kernel_layout(layout)
        self._truncation_m = layout.config.truncation_m
        self._pattern = sampling
        self._beta = float(np.exp(self._params[self._layout.log_beta]))

    def render(
        self, depth_m: np.ndarray, camera: Camera, T_world_cam: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """RGB [H, W, 3] 0..1 and planar depth [H, W] m as `camera` sees them from T_world_cam [4, 4].

        `depth_m` [H, W] places the samples; pixels with 0 are black, with depth 0.
        """
        pixels = np.flatnonzero(depth_m > 0)
        color = np.zeros((depth_m.size, 3), np.float32)
        depth = np.zeros(depth_m.size, np.float32)
        most = min(len(pixels), _CHUNK_RAYS)
        activations = field_activations(self._layout, most * self._pattern.count)
        for start in range(0, len(pixels), _CHUNK_RAYS):
            chunk = pixels[start : start + _CHUNK_RAYS]
            v, u = np.divmod(chunk, camera.width_px)
            rays, measured_m = pixel_rays(u, v, camera), depth_m.ravel()[chunk]
            color[chunk], depth[chunk] = self._rays(rays, measured_m, T_world_cam, activations)
        return np.clip(color, 0, 1).reshape(*depth_m.shape, 3), depth.reshape(depth_m.shape)

    def _rays(
        self, directions: np.ndarray, measured_m: np.ndarray, T: np.ndarray, acts: FieldActivations
    ) -> tuple[np.ndarray, np.ndarray]:
        R, S = len(directions), self._pattern.count
        z = sample_rays(measured_m, self._pattern, self._truncation_m, 1.0, None)  # [R, S]
        along = directions @ T[:3, :3].T  # [R, 3]
        points = T[:3, 3] + z[:, :, None] * along[:, None]  # [R, S, 3]
        flat = np.ascontiguousarray(points.reshape(-1, 3), np.float32)
        field_forward(self._params, self._layout, flat, R * S, acts)
        sdf = acts.sdf[: R * S].reshape(R, S)
        rgb = acts.rgb[: R * S].reshape(R, S, 3)
        inside = acts.inside[: R * S].reshape(R, S)
        color, depth = np.empty((R, 3), np.float32), np.empty(R, np.float32)
        opacity, weights = np.empty(R, np.float32), np.empty((R, S), np.float32)
        render_forward(sdf, rgb, inside, z, self._beta, weights, color, depth, opacity)
        return color, depth
