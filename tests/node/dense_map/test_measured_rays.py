"""Rays through voxels, to a wall that a keyframe measured."""

import numpy as np

from hsslam_node.dense_map.measured_rays import measured_reach
from hsslam_node.distance.distance_map import DistanceMap
from hsslam_node.distance.states import FREE, OCCUPIED, UNKNOWN
from hsslam_node.distance.voxel_grid import VoxelGrid

VOXEL_M = 0.05
WALL_M = 1.0  # its front, along z


def _room(unseen: int) -> DistanceMap:
    """Free space up to a wall; the last `unseen` voxels before it are unknown."""
    grid = VoxelGrid(VOXEL_M, (0, 0, 0), (8, 32, 24))
    middles_m = VOXEL_M * (np.arange(24) + 0.5)
    states = np.full(grid.shape, FREE, np.uint8)
    states[..., 20 - unseen :] = UNKNOWN
    states[..., 20] = OCCUPIED
    distance_m = np.broadcast_to(WALL_M - middles_m, grid.shape).astype(np.float32)
    return DistanceMap(grid, distance_m, states)


def _reach_m(unseen: int, *, over_gaps: bool) -> float:
    """How far along z a ray comes that meets the wall at 45 degrees."""
    origins, directions = np.array([[0.2, 0.2, 0.1]]), np.sqrt([[0.0, 0.5, 0.5]])
    far, over = np.array([10.0]), np.array([over_gaps])
    (reach_m,) = measured_reach(_room(unseen), origins, directions, far, over)
    return 0.1 + reach_m / np.sqrt(2)


def test_a_ray_ends_at_the_wall():
    for over_gaps in (False, True):
        assert abs(_reach_m(0, over_gaps=over_gaps) - WALL_M) < VOXEL_M


def test_one_unseen_voxel_before_the_wall_hides_it_only_from_rays_that_may_not_cross_it():
    assert np.isinf(_reach_m(1, over_gaps=False))
    assert abs(_reach_m(1, over_gaps=True) - WALL_M) < VOXEL_M


def test_a_wall_far_behind_the_seen_space_is_not_entered():
    assert np.isinf(_reach_m(5, over_gaps=True))
