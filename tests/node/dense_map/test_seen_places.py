"""Memory of what keyframes saw, in a corridor of walls that is longer than may be kept."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.dense_map.keyframes import MapKeyframes
from hsslam_node.dense_map.seen_places import SeenPlaces
from hsslam_node.dense_map.seen_space import SeenCells, SeenSpace
from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import se3_exp

REACH_M, REACH_OF_DEPTH_M = 0.06, 6.0
CAMERA = Camera(80, 60, 50.0, 50.0, 39.5, 29.5)
_EVERY_M, _KEYFRAMES = 2.0, 30
_MOST = 1_300_000  # cells; the corridor has 3 million


def _corridor(looked: list[int] | None = None) -> MapKeyframes:
    """Keyframes every 2 m along x that see slanting walls 1.2 m away; `looked` takes those that are read."""
    poses = np.stack([se3_exp(np.array([0, 0, 0, 0, 0.1 * (k % 3), 0])) for k in range(_KEYFRAMES)])
    poses[:, 0, 3] = _EVERY_M * np.arange(_KEYFRAMES)

    def depth_m(k: int) -> np.ndarray:
        if looked is not None:
            looked.append(k)
        slant = np.linspace(-0.05, 0.1, 80) * (1 + k % 4)
        return np.tile(1.2 + slant, (60, 1)).astype(np.float32)

    ids = np.arange(_KEYFRAMES)
    return MapKeyframes(CAMERA, ids, np.zeros(_KEYFRAMES, np.int64), poses, depth_m)


def _about(x_m: float, count: int = 3000) -> np.ndarray:
    """Points within a metre along the corridor."""
    rng = np.random.default_rng(0)
    return rng.uniform((x_m - 1, -0.7, 0.1), (x_m + 1, 0.7, 1.4), (count, 3))


def _told(places: SeenPlaces, keyframes: MapKeyframes, points: np.ndarray) -> SeenCells:
    told = places.follow_for(keyframes, points, 600.0)
    assert isinstance(told, SeenCells)
    return told


@pytest.fixture
def reports() -> list[str]:
    return []


@pytest.fixture
def places(reports) -> SeenPlaces:
    return SeenPlaces(REACH_M, REACH_OF_DEPTH_M, reports.append, _MOST)


def test_a_map_that_is_small_enough_is_followed_as_a_whole(reports):
    keyframes, places = _corridor(), SeenPlaces(REACH_M, REACH_OF_DEPTH_M, reports.append)
    whole = SeenSpace(REACH_M, max_depth_m=REACH_OF_DEPTH_M).follow(keyframes)
    for x_m in (0.0, 50.0):
        told = _told(places, keyframes, _about(x_m))
        assert told.grid == whole.grid and not reports
        np.testing.assert_array_equal(told.information, whole.information)
        np.testing.assert_array_equal(told.distances.distance_m, whole.distances.distance_m)


def test_a_larger_one_is_answered_as_before_in_less_memory(places, reports):
    keyframes = _corridor()
    whole = SeenSpace(REACH_M, max_depth_m=REACH_OF_DEPTH_M).follow(keyframes)
    assert whole.grid.count > 2 * _MOST
    for x_m in (0.0, 14.3, 27.0, 58.0, 3.0):
        points = _about(x_m)
        told = _told(places, keyframes, points)
        assert places.cells <= _MOST and told.grid.count <= _MOST
        ours, theirs = told.distances.query(points), whole.distances.query(points)
        assert (ours.known == theirs.known).mean() > 0.999 and theirs.known.mean() > 0.3
        both = ours.known & theirs.known
        np.testing.assert_allclose(ours.distance_m[both], theirs.distance_m[both], atol=0.005)
        assert (told.saw(points) == whole.saw(points)).mean() > 0.999
    assert len(reports) == 1 and f"more than {_MOST} cells of 0.05 m" in reports[0]


def test_only_keyframes_about_the_points_are_read_and_those_of_the_last_boxes_once(places):
    looked: list[int] = []
    keyframes = _corridor(looked)
    _told(places, keyframes, _about(30.0))
    counts = []
    for x_m in (2.0, 2.2, 30.0, 2.1, 58.0, 30.0):
        looked.clear()
        _told(places, keyframes, _about(x_m))
        counts.append(len(looked))
    assert counts[0] < 15 and counts[1:4] == [0, 0, 0]  # both are kept
    assert counts[4] > 0 and counts[5] > 0  # the third took the place of the older one
    assert places.cells <= _MOST


def test_what_takes_longer_is_gone_on_with(places):
    keyframes, points = _corridor(), _about(30.0)
    _told(places, keyframes, _about(2.0))
    left = []
    while isinstance(told := places.follow_for(keyframes, points, 0.0), int):
        left.append(told)
    assert left == sorted(left, reverse=True) and len(left) > 3
    assert told.saw(points).mean() > 0.3


def test_a_place_that_no_keyframe_saw_is_unknown(places):
    told = _told(places, _corridor(), _about(500.0))
    assert not told.saw(_about(500.0)).any() and not told.saw(_about(30.0)).any()


def test_points_that_lie_too_far_apart_are_one_line(places):
    keyframes = _corridor()
    points = np.array([[0.0, 0.0, 1.0], [58.0, 0.0, 1.0]])
    text = (
        r"points are up to 58 m apart: the space about them has more than 1300000 cells of 0.05 m"
    )
    with pytest.raises(UserError, match=text):
        places.follow_for(keyframes, points, 600.0)
    assert places.cells == 0
    assert _told(places, keyframes, points[:1]).saw(points[:1]).all()


def test_places_that_nothing_saw_take_no_more_memory_the_more_are_asked_for(places):
    keyframes = _corridor()
    _told(places, keyframes, _about(2.0))
    for x_m in range(500, 1500, 10):
        _told(places, keyframes, _about(x_m, 10))
    assert 0 < len(places._boxes) <= 32


def test_a_wide_box_that_has_become_too_large_is_no_error_of_a_small_query(places):
    keyframes = _corridor()
    few = replace(keyframes, ids=keyframes.ids[:3], T_world_cam=keyframes.T_world_cam[:3])
    _told(places, keyframes, _about(2.0))  # the map is too large
    _told(places, few, np.array([[0.0, 0.0, 1.0], [58.0, 0.0, 1.0]]))
    points = _about(30.0)
    assert _told(places, keyframes, points).saw(points).mean() > 0.3
