"""Runs all kernels of a rolling window once; apart from the window, as only a warm-up calls it."""

import numpy as np

from hsslam_node.distance.distance_blocks import DistanceBlocks
from hsslam_node.distance.distance_meter import DistanceMeter
from hsslam_node.distance.floor_plane import FloorPlane, find_floor
from hsslam_node.distance.grid_map import grid_map
from hsslam_node.distance.whole_map import whole_map
from hsslam_node.geometry.camera import Camera

_CAMERA = Camera(160, 120, 150.0, 150.0, 79.5, 59.5)
_WALL_M, _VOXEL_M = 2.0, 0.1


def warm_distances() -> None:
    """Compile the kernels for distances, or load them: else a window waits for one, up to seconds each."""
    depth_m = np.full((_CAMERA.height_px, _CAMERA.width_px), _WALL_M, np.float32)
    find_floor([(depth_m, np.eye(4))], _CAMERA)
    floor = FloorPlane((0.0, -1.0, 0.0), -1.0, "camera poses")
    space = whole_map([(depth_m, np.eye(4))], _CAMERA, floor, _VOXEL_M)
    blocks = DistanceBlocks()
    for _ in range(2):  # blocks that have changed, then none
        distances = DistanceMeter().measure(space)
        blocks.renew(distances)
    distances.query(np.zeros((1, 3)))
    grid_map(space, space.grid.low[2], space.grid.high[2]).distances_m()
    space.move_to(np.full(3, 100.0))
