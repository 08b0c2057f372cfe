"""How well a frame's depth points lie on the surface of the map."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.config import TrackerConfig
from hsslam_node.kernels.alignment import add_sdf_term
from hsslam_node.kernels.depth_points import transform_points
from hsslam_node.kernels.sdf_query import query_sdf
from hsslam_node.tracking.map_view import MapView


@dataclass(frozen=True)
class SurfaceFit:
    """Evidence for a pose."""

    inlier_ratio: float  # points within the Huber threshold of the surface over points in the bound
    rms_m: float  # distance of the inliers
    outside: int  # points outside the bound


def surface_fit(
    points: np.ndarray, T_world_cam: np.ndarray, view: MapView, config: TrackerConfig
) -> SurfaceFit:
    """The fit of points [N, 3] float32 (m, camera) seen from T_world_cam [4, 4]."""
    n = len(points)
    world = np.empty((n, 3), np.float32)
    sdf, inside = np.empty(n, np.float32), np.empty(n, np.uint8)
    gradient = np.zeros((n, 3), np.float32)
    transform_points(T_world_cam, points, world)
    query_sdf(view.params, view.layout, world, sdf, inside, gradient, False)
    _, inliers, seen, squares = add_sdf_term(
        sdf, gradient, inside, world, points[:, 2], T_world_cam[:3, 3].copy(), view.truncation_m,
        config.sdf_sigma_m, config.sdf_sigma_slope, config.sdf_huber_m,
        np.zeros((8, 8)), np.zeros(8),
    )  # fmt: skip
    return SurfaceFit(inliers / max(seen, 1), float(np.sqrt(squares / max(inliers, 1))), n - seen)
