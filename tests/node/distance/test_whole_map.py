"""Distances of the small built-in room against its true mesh."""

import numpy as np
import pytest

from hsslam_node.distance.distance_meter import DistanceMeter
from hsslam_node.distance.floor_plane import find_floor
from hsslam_node.distance.grid_map import CELL_FREE, CELL_OCCUPIED, grid_map
from hsslam_node.distance.states import FREE
from hsslam_node.distance.whole_map import whole_map
from hsslam_node.errors import UserError
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.evaluation.mesh.mesh_metrics import distances as true_distances
from hsslam_node.geometry.se3 import inverse
from tests.node.distance.conftest import wall
from tests.small_room import OPTIONS, room_frames, room_poses


@pytest.fixture(scope="module")
def views():
    return [(f.depth_m(), T) for f, T in zip(room_frames(), room_poses(), strict=True)][::4]


@pytest.fixture(scope="module")
def floor(views):
    return find_floor(views, room_frames()[0].camera)


@pytest.fixture(scope="module")
def found(views, floor):
    return DistanceMeter().measure(whole_map(views, room_frames()[0].camera, floor, 0.05))


@pytest.fixture(scope="module")
def free_points(found):
    """Points in free voxels, world."""
    grid, rng = found.grid, np.random.default_rng(0)
    indices = np.argwhere(found.states == FREE)
    indices = indices[rng.integers(len(indices), size=3000)] + rng.uniform(-0.5, 0.5, (3000, 3))
    T = inverse(found.T_grid_world)
    return grid.centres(indices) @ T[:3, :3].T + T[:3, 3]


@pytest.fixture(scope="module")
def truth(free_points):
    open_truth = open_ground_truth("synth:room", OPTIONS)
    mesh, T = open_truth.mesh(), inverse(open_truth.T_world_cam[0])
    vertices = mesh.vertices @ T[:3, :3].T + T[:3, 3]
    return true_distances(free_points, vertices, mesh.faces)


def test_distances_near_surfaces_agree_with_the_true_mesh(found, free_points, truth):
    """Near ones with nothing unseen nearer: a short walk leaves much unseen."""
    answer = found.query(free_points)
    assert answer.known.all()
    near = (truth < 0.3) & found.is_certain(free_points)
    error = answer.distance_m[near] - truth[near]
    assert near.sum() > 300
    assert np.median(np.abs(error)) < 0.01 and (np.abs(error) < 0.05).mean() > 0.99
    assert (answer.distance_m - truth < -0.06).mean() < 0.01  # too near, anywhere


def test_free_space_is_free_in_truth(truth):
    assert (truth > 0.01).mean() > 0.99


def test_the_grid_has_free_floor_and_obstacles(found):
    cells = grid_map(found).cells
    assert (cells == CELL_FREE).sum() > 300 and (cells == CELL_OCCUPIED).sum() > 50


def test_views_without_depth_are_refused(camera, floor):
    with pytest.raises(UserError, match="no view has depth"):
        whole_map([(wall(0.0), np.eye(4))], camera, floor)


def test_depth_beyond_the_limit_of_the_mapping_is_not_used(camera, floor):
    views = [(wall(1.5), np.eye(4)), (wall(3.0), np.eye(4))]
    near, both = (
        (whole_map(views, camera, floor, max_depth_m=limit_m).states() == FREE).sum()
        for limit_m in (2.0, 12.0)
    )
    assert 0 < near < both
