"""Which part of a surface a set of depth cameras saw."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import inverse
from hsslam_node.kernels.compiled import njit


class Observer(Protocol):
    """Decides which points of a surface count."""

    def observed(self, points: np.ndarray) -> np.ndarray:
        """Mask [N] of the points [N, 3] (m, world) that count."""
        ...


@dataclass(frozen=True)
class Views:
    """Depth cameras with known poses; they decide which points of a surface are observed.

    A point was observed if it lies in a frustum, not deeper than the depth measured at its pixel
    plus `tolerance_m`. A pixel without measurement sees nothing.
    """

    camera: Camera  # pinhole, no distortion
    T_world_cam: np.ndarray  # [V, 4, 4]
    depths_m: np.ndarray  # [V, H, W] float32
    tolerance_m: float = 0.03

    def observed(self, points: np.ndarray) -> np.ndarray:
        """Mask [N] of the points [N, 3] (m, world) that at least one camera saw."""
        return self._seen(points, False)

    def in_frustum(self, points: np.ndarray) -> np.ndarray:
        """Mask [N] of the points [N, 3] (m, world) in the frustum of at least one camera."""
        return self._seen(points, True)

    def _seen(self, points: np.ndarray, through_walls: bool) -> np.ndarray:
        c = self.camera
        intrinsics = np.array([c.fx, c.fy, c.cx, c.cy])
        points = np.ascontiguousarray(points, np.float64)
        tolerance_m = self.tolerance_m
        return _seen(
            points, self._T_cam_world, self.depths_m, intrinsics, tolerance_m, through_walls
        )

    @cached_property
    def _T_cam_world(self) -> np.ndarray:
        return np.array([inverse(T) for T in self.T_world_cam]).reshape(-1, 4, 4)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _seen(points, T_cam_world, depths, intrinsics, tolerance, through_walls):
    views, height, width = depths.shape
    seen = np.zeros(len(points), np.bool_)
    for i in range(len(points)):
        x, y, z = points[i]
        for k in range(views):
            T = T_cam_world[k]
            depth = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
            if depth < 0.01:
                continue
            across = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
            down = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
            u = np.floor(across / depth * intrinsics[0] + intrinsics[2] + 0.5)
            v = np.floor(down / depth * intrinsics[1] + intrinsics[3] + 0.5)
            if u < 0 or v < 0 or u >= width or v >= height:
                continue
            measured = depths[k, int(v), int(u)]
            if through_walls or (measured > 0 and depth <= measured + tolerance):
                seen[i] = True
                break
    return seen
