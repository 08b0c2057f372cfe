"""Errors are those of distances and gradients, and what is made worse is seen to be worse."""

import numpy as np
import pytest
import trimesh

from hsslam_bench.free_space.distance_errors import distance_errors, free_points, true_distances
from hsslam_bench.free_space.run import free_space, true_views
from hsslam_bench.free_space.update_time import update_time
from hsslam_node.distance.distance_map import DistanceMap
from hsslam_node.distance.states import FREE, OCCUPIED
from hsslam_node.distance.voxel_grid import VoxelGrid
from hsslam_node.geometry.se3 import inverse, se3_exp
from tests.small_room import OPTIONS, SMALL

T_WORLD_MESH = se3_exp(np.array([0.5, -0.2, 0.3, 0.4, 0.1, -0.3]))


@pytest.fixture(scope="module")
def plane() -> trimesh.Trimesh:
    """The plane z = 0 in the mesh's frame, 20 m wide."""
    corners = np.array([(-10, -10, 0), (10, -10, 0), (10, 10, 0), (-10, 10, 0)], float)
    return trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3)], process=False)


@pytest.fixture(scope="module")
def exact() -> DistanceMap:
    """Free up to 2 m above the plane, with exact distances, in the plane's own axes."""
    grid = VoxelGrid(0.1, (-10, -10, 0), (20, 20, 20))
    z = grid.centres(np.argwhere(np.ones(grid.shape, bool)))[:, 2].reshape(grid.shape)
    states = np.full(grid.shape, FREE, np.uint8)
    states[:, :, 0] = OCCUPIED
    return DistanceMap(grid, z.astype(np.float32), states, inverse(T_WORLD_MESH))


def _errors(distances, plane, bias_m=0.0):
    points = free_points(distances, 2000, 0)
    truth = true_distances(points, plane, T_WORLD_MESH)
    found = distances.query(points)
    biased = found._replace(distance_m=found.distance_m + np.float32(bias_m))
    return distance_errors(biased, truth, 3.0, found.known)


def test_exact_distances_have_no_error(exact, plane):
    errors = _errors(exact, plane)
    assert errors.points == 2000
    assert errors.mean_m < 0.002 and errors.within_5cm == 1.0  # but for the half voxel at the top
    assert errors.optimistic_5cm == errors.pessimistic_5cm == 0.0 and errors.gradient_deg < 0.1


def test_a_bias_is_told_with_its_side(exact, plane):
    far, near = _errors(exact, plane, 0.06), _errors(exact, plane, -0.06)
    assert far.mean_m == pytest.approx(0.06, abs=0.003) and near.mean_m == pytest.approx(
        0.06, abs=0.003
    )
    assert far.optimistic_5cm > 0.95 and far.pessimistic_5cm == 0.0
    assert near.pessimistic_5cm > 0.95 and near.optimistic_5cm == 0.0


def test_a_turned_gradient_is_told(exact, plane):
    points = free_points(exact, 500, 0)
    truth = true_distances(points, plane, T_WORLD_MESH)
    found = exact.query(points)
    turned = found.gradient @ se3_exp(np.array([0, 0, 0, 0.1, 0, 0]))[:3, :3].T
    errors = distance_errors(found._replace(gradient=turned), truth, 3.0, found.known)
    assert 2.0 < errors.gradient_deg < 5.8


def test_free_points_lie_in_free_voxels(exact):
    points = free_points(exact, 500, 1)
    assert exact.query(points).known.all()
    T = exact.T_grid_world
    assert ((points @ T[:3, :3].T + T[:3, 3])[:, 2] >= 0.1 - 1e-9).all()


def test_the_small_room_at_true_poses():
    found = free_space(true_views(SMALL, "synth:room", OPTIONS), "synth:room", OPTIONS, 0.05)
    certain, everything = found["certain"], found["all"]
    assert found["keyframes"] == 10 and found["up"] == "floor plane"
    assert 1000 < certain["points"] < everything["points"]
    assert certain["mean_m"] < 0.02 and certain["within_5cm"] > 0.98
    assert certain["gradient_deg"] < 12 and certain["mean_m"] < everything["mean_m"]


def test_an_update_of_the_small_room_is_timed():
    found = update_time("synth:room", OPTIONS)
    assert found["updates"] == 9
    assert 0 < found["median_ms"] <= found["p99_ms"]
    parts = sum(
        found[f"{name}_ms"] for name in ("observe", "distances", "grid", "slice_and_blocks")
    )
    assert parts == pytest.approx(found["mean_ms"]) and found["points_per_s"] > 1e5
