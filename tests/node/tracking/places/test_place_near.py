"""A person says where about the camera is: that decides where the images leave it open, and nowhere else."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse, se3_exp, so3_exp
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.tracking.places.place_near import Whereabouts
from hsslam_node.tracking.places.relocalisation import Relocalisation
from hsslam_node.tracking.tracker import Tracker
from tests.small_room import SMALL, pose_error, room_frames, room_poses

UP = np.array([0.0, -1.0, 0.0])
ASIDE = se3_exp(np.array([5.0, 0, 0, 0, 0, 0]))


@cache
def _blurred() -> tuple[Frame, ...]:
    """The frames without detail: places are not recognised in them."""
    return tuple(replace(f, color=cv2.GaussianBlur(f.color, (0, 0), 5)) for f in room_frames())


def _store(frames: tuple[Frame, ...], *worlds: np.ndarray) -> KeyframeStore:
    """The room, once in each of these places [4, 4]."""
    first = frames[0]
    store = KeyframeStore.create(MemoryAllocator(), first.camera, first.depth_units_per_m, 64)
    for T in worlds:
        for k in range(0, 40, 5):
            store.append(frames[k], T @ room_poses()[k])
    return store


def _places(frames: tuple[Frame, ...], *worlds: np.ndarray) -> Relocalisation:
    places = Relocalisation(SMALL.tracker, _store(frames, *worlds), 0)
    places.observe_all()
    return places


def _off(T: np.ndarray, distance_m: float, turn_deg: float, ahead_deg: float = 0.0) -> Whereabouts:
    """A camera's pose as a person says it: so far off on the floor, and turned."""
    said, way = T.copy(), np.deg2rad(ahead_deg)
    said[:3, 3] += distance_m * np.array([np.cos(way), 0, np.sin(way)])
    said[:3, :3] = so3_exp(np.deg2rad(turn_deg) * UP) @ said[:3, :3]
    return Whereabouts(said, UP)


@pytest.mark.parametrize("ahead_deg", [0, 120, 240])
def test_of_two_places_that_look_the_same_it_is_the_one_that_was_named(ahead_deg):
    frame, T = room_frames()[12], room_poses()[12]
    places = _places(room_frames(), np.eye(4), ASIDE)
    assert list(places.places(frame)) == []
    for world in (np.eye(4), ASIDE):
        place = places.place_near(frame, _off(world @ T, 0.5, 25, ahead_deg))
        assert place is not None
        distance_m, angle_deg = pose_error(place.T_world_cam, world @ T)
        assert distance_m < 0.01 and angle_deg < 0.3


@pytest.mark.parametrize("ahead_deg", [0, 120, 240])
def test_a_view_without_features_is_aligned_about_the_place(ahead_deg):
    frame, T = _blurred()[12], room_poses()[12]
    places = _places(_blurred(), np.eye(4))
    assert list(places.places(frame)) == []
    place = places.place_near(frame, _off(T, 0.4, -20, ahead_deg))
    assert place is not None
    distance_m, angle_deg = pose_error(place.T_world_cam, T)
    assert distance_m < 0.01 and angle_deg < 0.3


@pytest.mark.parametrize("frames", [room_frames, _blurred])
def test_a_wrong_place_is_not_believed(frames):
    """Where there is nothing; where a keyframe shows something else; the right place, looking back."""
    places = _places(frames(), np.eye(4))
    frame, T = frames()[12], room_poses()[12]
    for near in (_off(T, 5.0, 0), _off(T, 1.8, 0, 90), _off(T, 0.0, 180), _off(T, 1.2, 50)):
        assert places.place_near(frame, near) is None


def test_of_two_places_with_other_pictures_the_named_one_is_not_believed():
    """The same room with other colours: its shape fits, what hangs there does not."""
    other = tuple(replace(f, color=f.color[::-1, ::-1].copy()) for f in room_frames())
    places = _places(other, np.eye(4))
    for k in (2, 12, 33):
        assert places.place_near(room_frames()[k], _off(room_poses()[k], 0.2, 5)) is None


def test_the_tracker_goes_on_where_it_was_told_and_changes_nothing_elsewhere():
    store = _store(room_frames(), np.eye(4), ASIDE)
    tracker, not_asked = Tracker(SMALL, store, 0), Tracker(SMALL, store, 0)
    for each in (tracker, not_asked):
        each.resume(anywhere=True)
    T_last = inverse(room_poses()[0]) @ room_poses()[2]
    for k in (2, 3):
        frame = room_frames()[k]
        wrong = _off(T_last, 5.0, 0, 90)
        assert tracker.find_near(frame, None, wrong, localise_only=True) is None
        result = tracker.track(frame, None, localise_only=True)
        expected = not_asked.track(frame, None, localise_only=True)
        assert result.status == expected.status
        assert (result.T_world_cam == expected.T_world_cam).all()
    found = tracker.find_near(room_frames()[4], None, _off(T_last, 0.3, 10), localise_only=True)
    assert found is not None and found.status == "tracked" and not found.is_keyframe
    assert found.is_carried
    for k in range(5, 12):
        result = tracker.track(room_frames()[k], None, localise_only=True)
        truth = inverse(room_poses()[0]) @ room_poses()[k]
        distance_m, angle_deg = pose_error(result.T_world_cam, truth)
        assert result.status == "tracked" and distance_m < 0.02 and angle_deg < 0.5
        assert not result.is_carried
    assert store.count == 16


def test_a_camera_that_is_tracked_while_the_map_grows_is_not_moved():
    tracker = Tracker(SMALL, _store(room_frames()[:1]), 0)
    for frame in room_frames()[:3]:
        tracker.track(frame, None)
    near = Whereabouts(room_poses()[3], UP)
    assert tracker.find_near(room_frames()[3], None, near) is None
