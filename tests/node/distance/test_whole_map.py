"""Distances of the small built-in room against its true mesh."""

import numpy as np
import pytest

from hsslam_node.distance.distance_meter import DistanceMeter
from hsslam_node.distance.floor_plane import find_floor
from hsslam_node.distance.grid_map import CELL_FREE, CELL_OCCUPIED, grid_map
from hsslam_node.distance.refined_distances import RefinedDistances
from hsslam_node.distance.states import FREE
from hsslam_node.distance.whole_map import whole_map
from hsslam_node.errors import UserError
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.evaluation.mesh.mesh_metrics import distances as true_distances
from hsslam_node.geometry.se3 import inverse
from hsslam_node.meshing.map_queries import MapQueries
from tests.node.distance.conftest import wall
from tests.small_room import OPTIONS, SMALL, mapped_room, room_frames, room_poses


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
    """Points in free voxels with nothing unknown nearer than what is occupied, world."""
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
    """Near ones only: what a short walk has not seen may be nearer than what it has."""
    answer = found.query(free_points)
    assert answer.known.all()
    near = truth < 0.3
    error = answer.distance_m[near] - truth[near]
    assert near.sum() > 300
    assert np.median(np.abs(error)) < 0.01 and (np.abs(error) < 0.05).mean() > 0.95
    assert (answer.distance_m - truth < -0.06).mean() < 0.01  # too near, anywhere


def test_free_space_is_free_in_truth(truth):
    assert (truth > 0.01).mean() > 0.99


def test_the_field_refines_distances_near_surfaces(found, free_points, truth):
    room = mapped_room()
    query = MapQueries(room.parameters.layout, room.parameters.params).sdf_and_gradient
    refined = RefinedDistances(found, query, SMALL.field.truncation_m).query(free_points)
    plain = found.query(free_points)
    far = plain.distance_m > SMALL.field.truncation_m
    np.testing.assert_array_equal(refined.distance_m[far], plain.distance_m[far])
    near = truth < 0.5 * SMALL.field.truncation_m
    assert near.sum() > 20
    assert np.median(np.abs(refined.distance_m - truth)[near]) < 0.01
    assert (refined.distance_m != plain.distance_m)[near].mean() > 0.8


def test_refined_distances_have_no_step(found, views):
    """Along rays from the first camera into the walls, in steps of a millimetre."""
    room = mapped_room()
    refined = RefinedDistances(
        found, MapQueries(room.parameters.layout, room.parameters.params).sdf_and_gradient, 0.06
    )
    along = np.arange(0.5, 2.5, 0.001)
    for direction in ((0.1, 0.0, 1.0), (-0.2, 0.1, 1.0)):
        points = along[:, None] * np.array(direction) / np.linalg.norm(direction)
        answer = refined.query(points)
        steps = np.abs(np.diff(answer.distance_m[answer.known]))
        assert len(steps) > 500 and steps.max() < 0.006


def test_the_grid_has_free_floor_and_obstacles(found):
    cells = grid_map(found).cells
    assert (cells == CELL_FREE).sum() > 300 and (cells == CELL_OCCUPIED).sum() > 50


def test_views_without_depth_are_refused(camera, floor):
    with pytest.raises(UserError, match="no view has depth"):
        whole_map([(wall(0.0), np.eye(4))], camera, floor)
