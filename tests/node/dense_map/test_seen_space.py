"""Cells that keyframes saw, in an analytic room: a sphere on the floor of a box."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.dense_map.keyframes import MapKeyframes
from hsslam_node.dense_map.seen_space import SeenCells, SeenSpace, certainty_of
from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import se3_exp

REACH_M, CELL_M = 0.06, 0.05
CAMERA = Camera(80, 60, 50.0, 50.0, 39.5, 29.5)


def _wall(z_m: float, T_world_cam: np.ndarray | None = None, k: int = 0) -> MapKeyframes:
    """One keyframe that sees a wall straight ahead."""
    pose = np.eye(4) if T_world_cam is None else T_world_cam
    depth = np.full((60, 80), z_m, np.float32)
    depth[:, :8] = 0.0  # nothing measured at the left
    return MapKeyframes(CAMERA, np.array([k]), np.zeros(1, np.int64), pose[None], lambda _: depth)


def _joined(*parts: MapKeyframes) -> MapKeyframes:
    return MapKeyframes(
        CAMERA,
        np.concatenate([part.ids for part in parts]),
        np.concatenate([part.stamps_ns for part in parts]),
        np.concatenate([part.T_world_cam for part in parts]),
        lambda k: parts[k].depth_m(0),
    )


def _information(seen: SeenCells, points: np.ndarray) -> np.ndarray:
    """Of the cells that hold the points [N, 3], which are of the grid."""
    return seen.information[tuple(seen.grid.indices(points).T)]


def test_seen_is_what_lies_in_view_before_the_wall_or_just_behind_its_front():
    seen = SeenSpace(REACH_M, CELL_M).follow(_wall(2.0))
    rng = np.random.default_rng(0)
    points = rng.uniform((-2, -2, -1), (2, 2, 4), (20000, 3))
    x, y, z = points.T
    u, v = x / z * 50 + 39.5, y / z * 50 + 29.5
    margin_px, cell = 50 * CELL_M / np.maximum(np.abs(z), 0.1), CELL_M
    deep = (z > 0.1 + cell) & (z < 2.0 + REACH_M - cell)
    inside = deep & (u > 7.5 + margin_px) & (u < 79.5 - margin_px)
    inside &= (v > -0.5 + margin_px) & (v < 59.5 - margin_px)
    outside = (z < 0.1 - cell) | (z > 2.0 + REACH_M + cell) | (u < 7.5 - margin_px)
    outside |= (u > 79.5 + margin_px) | (v < -0.5 - margin_px) | (v > 59.5 + margin_px)
    known = seen.saw(points)
    assert inside.sum() > 1000 and known[inside].all()
    assert outside.sum() > 1000 and not known[outside].any()
    assert not seen.saw(np.array([[0.0, 0.0, 99.0], [0.0, 0.0, -99.0]])).any()


def test_a_camera_that_looks_almost_along_the_cells_sees_as_one_that_does():
    exact = SeenSpace(REACH_M, CELL_M).follow(_wall(2.0))
    turned = se3_exp(np.array([0.0, 0.0, 0.0, 1e-17, 1e-16, -1e-15]))
    turned[0, 1], turned[2, 0] = 1e-30, -1e-300  # a border of the view is all but parallel to a row
    almost = SeenSpace(REACH_M, CELL_M).follow(_wall(2.0, turned))
    differ = (exact.information > 0) != (almost.information > 0)
    assert differ.mean() < 1e-3


def test_more_and_nearer_looks_make_a_place_more_certain():
    near, far = np.array([[0.1, 0.1, 1.0]]), np.array([[0.1, 0.1, 2.0]])

    def certainty(keyframes: MapKeyframes, point: np.ndarray) -> float:
        seen = SeenSpace(REACH_M, CELL_M).follow(keyframes)
        index = tuple(seen.grid.indices(point)[0])
        return float(certainty_of(seen.information[index]))

    once = _wall(3.0)
    twice = _joined(_wall(3.0), _wall(3.0, k=1))
    assert 0 < certainty(once, far) < certainty(twice, far) < certainty(once, near) < 1


@pytest.mark.parametrize(
    ("depth_m", "looks", "expected"),
    [(1.0, 1, 0.97), (2.0, 1, 0.66), (4.0, 1, 0.11), (4.0, 10, 0.55), (2.0, 10, 0.95)],
)
def test_certainty_is_what_its_docstring_says(depth_m, looks, expected):
    information = np.float32(looks / (1.8e-3 * depth_m**2) ** 2)
    assert certainty_of(information) == pytest.approx(expected, abs=0.005)


def test_new_keyframes_are_added_and_only_they_are_looked_at():
    looked: list[int] = []
    both = _joined(_wall(2.0), _wall(2.3, k=5))
    told = replace(both, depth_m=lambda k: looked.append(k) or both.depth_m(k))
    space = SeenSpace(REACH_M, CELL_M)
    space.follow(_wall(2.0))
    by_and_by = space.follow(told)
    assert set(looked) == {1}
    at_once = SeenSpace(REACH_M, CELL_M).follow(both)
    points = np.random.default_rng(0).uniform((-1, -1, 0.2), (1, 1, 2.2), (4000, 3))
    expected = _information(at_once, points)
    assert (expected > 0).mean() > 0.3
    assert np.isclose(_information(by_and_by, points), expected).mean() > 0.99  # border: rounding
    space.follow(_wall(2.3, k=5))  # the first has retired; what it saw stays
    assert np.isclose(_information(space.follow(both), points), expected).mean() > 0.99


def test_marks_follow_corrected_poses_and_keyframes_that_see_farther():
    space = SeenSpace(REACH_M, CELL_M)
    space.follow(_wall(2.0))
    turned = _wall(2.0, se3_exp(np.array([0.1, 0.0, 0.0, 0.0, 0.5, 0.0])))
    elsewhere = _wall(2.0, se3_exp(np.array([5.0, 1.0, 0.0, 0.0, 0.0, 0.0])), k=1)
    for keyframes in (turned, _joined(turned, elsewhere)):
        followed, afresh = space.follow(keyframes), SeenSpace(REACH_M, CELL_M).follow(keyframes)
        points = np.random.default_rng(1).uniform((-3, -3, -1), (8, 3, 4), (8000, 3))
        np.testing.assert_array_equal(followed.saw(points), afresh.saw(points))
        assert followed.saw(points).mean() > 0.01
    assert afresh.saw(np.array([[5.0, 1.0, 1.0]])).all()


def test_depth_beyond_that_of_the_mapping_counts_as_none():
    """As of cameras that write the largest number where they measure nothing."""
    keyframes, marked = _wall(2.0), _wall(2.0)
    keyframes.depth_m(0)[8, 16], marked.depth_m(0)[8, 16] = 0.0, 20.0
    without, seen = (SeenSpace(REACH_M, CELL_M).follow(each) for each in (keyframes, marked))
    assert seen.grid == without.grid
    np.testing.assert_array_equal(seen.information, without.information)
    farther = SeenSpace(REACH_M, CELL_M, max_depth_m=30.0).follow(marked)
    assert farther.grid.high[2] > 20.0


def test_surfaces_count_that_were_seen_from_less_than_far():
    before = np.array([[0.1, 0.1, 1.8]])  # 20 cm before a wall
    near, far = (SeenSpace(REACH_M, CELL_M, far_m=far_m).follow(_wall(2.0)) for far_m in (1.5, 4.0))
    assert not near.distances.query(before).known[0]
    assert far.distances.query(before).distance_m[0] == pytest.approx(0.2, abs=0.03)


def test_a_map_without_keyframes_is_one_line():
    poses, none = np.zeros((0, 4, 4)), np.zeros(0, np.int64)
    keyframes = MapKeyframes(CAMERA, none, none, poses, lambda _: np.zeros((60, 80), np.float32))
    with pytest.raises(UserError, match="the map has no keyframes: expected one or more"):
        SeenSpace(REACH_M, CELL_M).follow(keyframes)


def test_what_takes_longer_is_gone_on_with():
    """No time at all: a keyframe a call, and the last one is answered."""
    parts = [_wall(2.0 + 0.3 * k, se3_exp(np.array([0.4 * k, 0, 0, 0, 0, 0])), k) for k in range(4)]
    keyframes, space = _joined(*parts), SeenSpace(REACH_M, CELL_M)
    assert [space.follow_for(keyframes, 0.0) for _ in range(3)] == [3, 2, 1]
    told, at_once = space.follow_for(keyframes, 0.0), SeenSpace(REACH_M, CELL_M).follow(keyframes)
    assert isinstance(told, SeenCells)
    points = np.random.default_rng(0).uniform((-1, -1, 0.2), (2.5, 1, 2.8), (4000, 3))
    np.testing.assert_array_equal(told.saw(points), at_once.saw(points))
    assert told.saw(points).mean() > 0.3
    ours, theirs = told.distances.query(points), at_once.distances.query(points)
    np.testing.assert_allclose(ours.distance_m, theirs.distance_m, atol=1e-5)
    before = told.information.copy(order="F")
    space.follow(_joined(*parts, _wall(2.0, k=9)))
    np.testing.assert_array_equal(told.information, before)  # what was handed out stays


def test_the_distance_is_to_what_keyframes_measured():
    distances = SeenSpace(REACH_M, CELL_M).follow(_wall(2.0)).distances
    found = distances.query(np.array([[0.1, 0.1, 1.0], [0.1, 0.1, 1.7], [0.1, 0.1, 3.0]]))
    np.testing.assert_allclose(found.distance_m[:2], [1.0, 0.3], atol=0.03)
    assert list(found.known) == [True, True, False]
