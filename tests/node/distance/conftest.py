"""A camera in front of a wall, and the occupancy of a small space about it."""

import numpy as np
import pytest

from hsslam_node.distance.occupancy import Occupancy
from hsslam_node.distance.voxel_grid import VoxelGrid
from hsslam_node.geometry.camera import Camera


@pytest.fixture
def camera() -> Camera:
    """160 x 120 px, 53 degrees wide."""
    return Camera(160, 120, 160.0, 160.0, 79.5, 59.5)


@pytest.fixture
def space() -> Occupancy:
    """3 x 3 x 4 m in voxels of 5 cm; a camera at the origin looks along z, through its middle."""
    return Occupancy(VoxelGrid(0.05, (-30, -30, -10), (60, 60, 80)))


def wall(depth_m: float, noise_m: float = 0.0, seed: int = 0) -> np.ndarray:
    """Depth of a wall across the view, [120, 160] float32."""
    depth = np.full((120, 160), depth_m, np.float32)
    return depth + np.random.default_rng(seed).normal(0, noise_m, depth.shape).astype(np.float32)
