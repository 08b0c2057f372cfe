import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hsslam_node.distance.distance_map import DistanceMap
from hsslam_node.distance.distance_meter import DistanceMeter
from hsslam_node.distance.states import FREE, OCCUPIED, UNKNOWN
from hsslam_node.distance.voxel_grid import VoxelGrid
from hsslam_node.errors import UserError
from hsslam_node.geometry.se3 import inverse, se3_exp
from tests.node.distance.conftest import wall

GRID = VoxelGrid(0.05, (-10, -10, -10), (24, 22, 20))


def _linear(slope, T=None):
    """A map whose distance is linear in the grid's frame, all free."""
    centres = GRID.centres(np.argwhere(np.ones(GRID.shape, bool)))
    distance = (centres @ slope).reshape(GRID.shape).astype(np.float32)
    return DistanceMap(
        GRID, distance, np.full(GRID.shape, FREE, np.uint8), np.eye(4) if T is None else T
    )


@given(
    st.lists(st.floats(-1, 1), min_size=3, max_size=3),
    st.lists(st.floats(-1, 1), min_size=6, max_size=6),
)
@settings(max_examples=30)
def test_a_linear_distance_is_interpolated_exactly_in_any_frame(slope, twist):
    slope, T = np.array(slope), se3_exp(np.array(twist))
    points = np.random.default_rng(0).uniform(GRID.low + 0.05, GRID.high - 0.05, (200, 3))
    world = points @ T[:3, :3] + inverse(T)[:3, 3]
    found = _linear(slope, T).query(world)
    assert found.known.all()
    np.testing.assert_allclose(found.distance_m, points @ slope, atol=2e-5)
    np.testing.assert_allclose(
        found.gradient, np.broadcast_to(slope @ T[:3, :3], (200, 3)), atol=2e-4
    )


def test_outside_the_grid_nothing_is_known():
    found = _linear(np.ones(3)).query(np.array([[0.0, 0.0, 9.0], [-0.501, 0, 0], [0.0, 0.0, 0.0]]))
    assert found.known.tolist() == [False, False, True]
    assert np.isnan(found.distance_m[:2]).all() and (found.gradient[:2] == 0).all()


@pytest.mark.parametrize("points", [np.zeros(3), np.zeros((2, 2)), np.zeros((1, 1, 3)), 0.0])
def test_points_of_another_shape_are_refused(points):
    with pytest.raises(UserError, match=r"points \[[0-9, ]*\]: expected \[N, 3\]"):
        _linear(np.ones(3)).query(points)


def test_a_map_does_not_change():
    distances = _linear(np.ones(3))
    with pytest.raises(ValueError, match="read-only"):
        distances.distance_m[0, 0, 0] = 1.0


def test_arrays_of_another_shape_are_refused():
    with pytest.raises(ValueError, match="states is"):
        DistanceMap(GRID, np.zeros(GRID.shape, np.float32), np.zeros((1, 1, 1), np.uint8))


def test_distances_to_a_wall(space, camera):
    for seed in range(3):
        space.observe(wall(2.03, 0.005, seed), camera, np.eye(4))
    distances = DistanceMeter().measure(space)
    z = np.linspace(0.5, 1.98, 40)
    found = distances.query(np.stack([0.1 * np.ones(40), np.zeros(40), z], axis=1))
    assert found.known.all()
    np.testing.assert_allclose(found.distance_m, 2.03 - z, atol=0.01)
    np.testing.assert_allclose(found.gradient, np.broadcast_to([0.0, 0.0, -1.0], (40, 3)), atol=0.1)
    inside = distances.query(np.array([[0.1, 0.0, 2.045]]))
    assert inside.known.all() and inside.distance_m[0] < 0
    behind = distances.query(np.array([[0.1, 0.0, 2.4]]))
    assert not behind.known.any() and np.isnan(behind.distance_m).all()


def test_a_distance_beside_unseen_space_is_not_certain(space, camera):
    """The left half of the wall was not measured: what is before it may be nearer than the right half."""
    half = wall(2.03)
    half[:, :80] = 0
    for _ in range(3):
        space.observe(half, camera, np.eye(4))
    distances = DistanceMeter().measure(space)
    points = np.array([[0.4, 0, 1.8], [0.1, 0, 1.8], [0.4, 0, 1.2], [-0.4, 0, 1.8]])
    assert distances.query(points).known.tolist() == [True, True, True, False]
    assert distances.is_certain(points).tolist() == [True, False, False, False]


def test_distances_end_at_the_reach(space, camera):
    for _ in range(2):
        space.observe(wall(2.03), camera, np.eye(4))
    found = DistanceMeter(far_m=0.5).measure(space).query(np.array([[0.0, 0.0, 1.0], [0, 0, 1.8]]))
    np.testing.assert_allclose(found.distance_m, [0.5, 0.23], atol=0.01)


def test_free_space_without_obstacles_is_as_far_as_the_reach(space, camera):
    space.observe(wall(9.0), camera, np.eye(4))
    distances = DistanceMeter(far_m=1.0).measure(space)
    assert (distances.states == FREE).any() and not (distances.states == OCCUPIED).any()
    np.testing.assert_allclose(distances.distance_m[distances.states == FREE], 1.0)
    assert np.isnan(distances.distance_m[distances.states == UNKNOWN]).all()


def test_a_meter_measures_grids_of_other_shapes(space, camera):
    meter = DistanceMeter()
    meter.measure(space)
    space.observe(wall(2.03), camera, np.eye(4))
    again = meter.measure(space)
    fresh = DistanceMeter().measure(space)
    np.testing.assert_array_equal(again.distance_m, fresh.distance_m)


def test_a_reach_of_many_voxels_says_the_same_as_a_short_one(space, camera):
    for _ in range(2):
        space.observe(wall(2.03), camera, np.eye(4))
    near, far = (DistanceMeter(far_m).measure(space).distance_m for far_m in (1.0, 60.0))
    is_near = near < 1.0
    assert is_near.sum() > 1000 and np.nanmax(far) > 1.5
    np.testing.assert_array_equal(far[is_near], near[is_near])


def test_a_reach_of_nothing_or_too_much_is_refused(space, camera):
    with pytest.raises(UserError, match="far_m = -1"):
        DistanceMeter(-1)
    space.observe(wall(2.03), camera, np.eye(4))
    with pytest.raises(UserError, match=r"far_m = inf: expected 1638.4 m at most with voxels of"):
        DistanceMeter(np.inf).measure(space)
