"""A camera that is carried away is found where it has been before, and nowhere else."""

import threading
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse, se3_exp
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.sources.open_source import open_source
from hsslam_node.tracking.places.relocalisation import Relocalisation
from hsslam_node.tracking.tracker import Tracker
from tests.other_pictures import with_other_pictures
from tests.small_room import OPTIONS, SMALL, pose_error, room_frames, room_poses, with_black


@cache
def _elsewhere() -> tuple[Frame, ...]:
    """Views of the other side of the room, and of a hall with the same kinds of furniture."""
    far = replace(OPTIONS, frames=4, stride=90)
    hall = replace(far, synth=replace(OPTIONS.synth, seed=7, size_m=(9.0, 8.0, 3.0)))
    views = [*open_source("synth:room", far).frames()][2:]
    return tuple(
        f for f in (*views, *open_source("synth:room", hall).frames()) if isinstance(f, Frame)
    )


def _store() -> KeyframeStore:
    first = room_frames()[0]
    return KeyframeStore.create(MemoryAllocator(), first.camera, first.depth_units_per_m, 64)


def _filled(poses: np.ndarray) -> Relocalisation:
    """Over every fifth frame at these poses."""
    store = _store()
    for k in range(0, 40, 5):
        store.append(room_frames()[k], poses[k])
    return Relocalisation(SMALL.tracker, store, 0)


def _observe(places: Relocalisation) -> None:
    """As many tracked frames as one keyframe takes."""
    for _ in range(8):
        places.observe()


def test_a_view_between_keyframes_is_placed_beside_the_nearest():
    places = _filled(room_poses())
    for _ in range(3):
        _observe(places)
    for k in (2, 17, 33):
        (place,) = places.places(room_frames()[k])
        distance_m, angle_deg = pose_error(place.T_world_cam, room_poses()[k])
        assert distance_m < 0.01 and angle_deg < 0.3
        assert place.reference.id == round(k / 5)


def test_what_was_not_taken_in_while_tracking_is_taken_in_when_lost():
    places = _filled(room_poses())
    (newest,) = places.places(room_frames()[33])
    assert pose_error(newest.T_world_cam, room_poses()[33])[0] < 0.01
    found = [list(places.places(room_frames()[2])) for _ in range(6)]
    assert found[-1] and pose_error(found[-1][0].T_world_cam, room_poses()[2])[0] < 0.01


def test_nothing_is_said_of_a_place_never_seen():
    places = _filled(room_poses())
    for _ in range(8):
        _observe(places)
    for frame in (*_elsewhere(), with_black(room_frames()[0])):
        assert list(places.places(frame)) == []


def test_a_place_that_only_looks_like_one_of_the_map_is_not_taken_for_it():
    """The camera is in a room that the map does not know, with the same furniture and other pictures."""
    places = _filled(room_poses())
    places.observe_all()
    for k in (2, 17, 33):
        assert list(places.places(with_other_pictures(room_frames()[k]))) == []
        assert len(list(places.places(room_frames()[k]))) == 1


def test_a_keyframe_whose_view_was_covered_is_no_reference_for_one_that_is_not():
    """Something that moved took the depth of most pixels; the nearest whole keyframe is 5 frames away."""
    places, covered = _filled(room_poses()), room_frames()[12]
    raw = covered.depth_raw.copy()
    raw[:, 40:] = 0
    places._store.append(replace(covered, depth_raw=raw), room_poses()[12])
    places.observe_all()
    (place,) = places.places(room_frames()[12])
    assert place.reference.id in (2, 3)
    assert pose_error(place.T_world_cam, room_poses()[12])[0] < 0.01


def test_features_are_found_without_a_thread_to_start(monkeypatch):
    """Also the comparison with all keyframes, which a fragment asks for; later a thread starts."""
    places = _filled(room_poses())
    with monkeypatch.context() as machine:
        machine.setattr(threading.Thread, "start", _no_thread)
        for _ in range(3):
            _observe(places)
        assert {m.match.keyframe for m in places.compare(room_frames()[2]).result()} >= {0}
    assert len(list(places.places(room_frames()[17]))) == 1
    assert places.compare(room_frames()[33]).result()


def _no_thread(_: threading.Thread) -> None:
    raise RuntimeError("can't start new thread")


def test_two_places_that_look_the_same_are_not_told_apart():
    """The same views stored once more, two metres away: no pose is better than the other."""
    store = _store()
    aside = se3_exp(np.array([2.0, 0, 0, 0, 0, 0]))
    for T in (np.eye(4), aside):
        for k in (0, 20):
            store.append(room_frames()[k], T @ room_poses()[k])
    places = Relocalisation(SMALL.tracker, store, 0)
    for _ in range(4):
        _observe(places)
    assert list(places.places(room_frames()[2])) == []


@pytest.fixture(scope="module")
def carried_away() -> tuple[KeyframeStore, Tracker]:
    """A tracker that has seen 40 frames of the room and then others that it cannot know."""
    store = _store()
    tracker = Tracker(SMALL, store, 0)
    for frame in room_frames():
        assert tracker.track(frame, None).status != "lost"
    return store, tracker


def test_a_camera_carried_away_is_found_again(carried_away):
    store, tracker = carried_away
    stamp_ns, keyframes = room_frames()[-1].stamp_ns, store.count
    lookalike = tuple(with_other_pictures(room_frames()[k]) for k in (2, 17))
    for frame in (*_elsewhere(), *lookalike) * 2:
        stamp_ns += 33_000_000
        assert tracker.track(replace(frame, stamp_ns=stamp_ns), None).status == "lost"
    assert store.count == keyframes
    for start in (3, 22, 11):
        statuses = []
        for k in range(start, start + 6):
            stamp_ns += 33_000_000
            result = tracker.track(replace(room_frames()[k], stamp_ns=stamp_ns), None)
            statuses.append(result.status)
            if result.status == "tracked":
                truth = inverse(room_poses()[0]) @ room_poses()[k]
                distance_m, angle_deg = pose_error(result.T_world_cam, truth)
                assert distance_m < 0.02 and angle_deg < 0.5
        assert "lost" not in statuses[2:]
