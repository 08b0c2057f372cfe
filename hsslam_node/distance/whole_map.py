"""Occupancy of everything that a set of cameras saw."""

from collections.abc import Sequence

import numpy as np

from hsslam_node.distance.floor_plane import FloorPlane
from hsslam_node.distance.occupancy import FAR_M, Occupancy
from hsslam_node.distance.voxel_grid import VOXEL_M, VoxelGrid
from hsslam_node.errors import UserError
from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import world_points
from hsslam_node.presets import REALTIME

_STRIDE_PX = 8
_OUTLIERS = 0.002  # share of the points of a view that may lie outside, on each side
_MARGIN_M = 0.2


class NoDepthError(UserError):
    """No view has depth that may be used."""


def whole_map(
    views: Sequence[tuple[np.ndarray, np.ndarray]],
    camera: Camera,
    floor: FloorPlane,
    voxel_m: float = VOXEL_M,
    far_m: float = FAR_M,
    max_depth_m: float = REALTIME.mapper.max_depth_m,
) -> Occupancy:
    """Free and occupied voxels of all views, in the frame of the floor; later views have the last word.

    Args:
        views: depth [H, W] float32 m and T_world_cam [4, 4] of each; gone through twice.
        camera: of all views, undistorted.
        far_m: farther measurements say that the way up to there is free, and nothing else.
        max_depth_m: depth beyond this is not used.

    Raises:
        NoDepthError: no view has depth nearer than `far_m` and `max_depth_m`.
        UserError: the space is too large for such voxels.
    """
    T = floor.T_floor_world
    used_m = min(far_m, max_depth_m)
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for depth_m, T_world_cam in views:
        near_m = np.where(depth_m < used_m, depth_m, 0)
        points = world_points(near_m, camera, T @ T_world_cam, _STRIDE_PX)
        if len(points) == 0:
            continue
        position = (T @ T_world_cam)[:3, 3]
        low = np.minimum(low, np.minimum(np.quantile(points, _OUTLIERS, axis=0), position))
        high = np.maximum(high, np.maximum(np.quantile(points, 1 - _OUTLIERS, axis=0), position))
    if not np.isfinite(low).all():
        raise NoDepthError(f"no view has depth below {used_m:g} m: expected some")
    grid = VoxelGrid.over(Bound.of(low - _MARGIN_M, high + _MARGIN_M), voxel_m)
    occupancy = Occupancy(grid, T, far_m, max_depth_m)
    for depth_m, T_world_cam in views:
        occupancy.observe(depth_m, camera, T_world_cam)
    return occupancy
