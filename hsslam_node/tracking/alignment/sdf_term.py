"""The SDF term of an alignment, which pulls depth points to the map's surface: protocol and CPU code."""

from typing import NamedTuple, Protocol

import numpy as np

from hsslam_node.config import TrackerConfig
from hsslam_node.kernels.field.sdf_query import query_sdf
from hsslam_node.kernels.tracking.alignment import add_sdf_term
from hsslam_node.tracking.map_view import MapView

_STRAIGHT_M = 0.003  # steps over which the SDF is linear enough, without loss of accuracy


class SdfEvidence(NamedTuple):
    """Counts and residuals of the points."""

    inliers: int
    seen: int  # points in the bound
    squares_m2: float  # sum over the inliers


class SdfTerm(Protocol):
    """Adds the SDF residuals of the depth points of one frame to normal equations."""

    def add(
        self, T_world_cam: np.ndarray, world: np.ndarray, fine: bool, H: np.ndarray, b: np.ndarray
    ) -> SdfEvidence:
        """Add to H [8, 8] (its upper half) and b [8], linearised at the pose.

        See `kernels/tracking/alignment.py` for the system.
        world [N, 3] float32 m: the points of this level seen from T_world_cam [4, 4].
        """
        ...


class CpuSdfTerm:
    """Queries the published map in place."""

    def __init__(
        self, view: MapView, points: tuple[np.ndarray, np.ndarray], config: TrackerConfig
    ) -> None:
        self._view = view
        self._points = points
        self._config = config
        n = len(points[-1])
        self._sdf = np.empty(n, np.float32)
        self._gradient = np.empty((n, 3), np.float32)
        self._inside = np.empty(n, np.uint8)
        self._queried_at = np.empty((0, 3), np.float32)  # the fine points of the last query

    def add(
        self, T_world_cam: np.ndarray, world: np.ndarray, fine: bool, H: np.ndarray, b: np.ndarray
    ) -> SdfEvidence:
        c, n = self._config, len(world)
        inside, sdf, gradient = self._inside[:n], self._sdf[:n], self._gradient[:n]
        is_line = False
        if fine and len(self._queried_at) == n:
            step = world - self._queried_at  # [N, 3] m
            is_line = bool(np.abs(step).max() < _STRAIGHT_M)
        if is_line:
            sdf = sdf + np.einsum("ni,ni->n", gradient, step)
        else:
            query_sdf(self._view.params, self._view.layout, world, sdf, inside, gradient, True)
            self._queried_at = world.copy() if fine else self._queried_at
        _, inliers, seen, squares = add_sdf_term(
            sdf, gradient, inside, world, self._points[fine][:, 2], T_world_cam[:3, 3].copy(),
            self._view.truncation_m, c.sdf_sigma_m, c.sdf_sigma_slope, c.sdf_huber_m, H, b,
        )  # fmt: skip
        return SdfEvidence(inliers, seen, squares)
