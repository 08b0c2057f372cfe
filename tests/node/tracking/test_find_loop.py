"""A view of a known place gives the relative pose; another place gives nothing."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse, se3_exp
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.place_recognition.keyframe_index import KeyframeIndex
from hsslam_node.sources.open_source import open_source
from hsslam_node.tracking.find_loop import LoopLimits, find_loop
from tests.small_room import OPTIONS, SMALL, pose_error, room_frames, room_poses, with_black


@pytest.fixture(scope="module")
def places() -> tuple[KeyframeStore, KeyframeIndex]:
    """Every eighth frame, with poses that are none: a loop must not depend on them."""
    first = room_frames()[0]
    store = KeyframeStore.create(MemoryAllocator(), first.camera, first.depth_units_per_m, 64)
    for k, frame in enumerate(room_frames()[::8]):
        store.append(frame, se3_exp(np.array([3.0 * k, 0, 0, 0, 1.0 * k, 0])))
    index = KeyframeIndex(store)
    index.update()
    return store, index


def test_a_frame_finds_its_place(places):
    store, index = places
    for i in (3, 13, 36):
        matches = find_loop(store, index, room_frames()[i], SMALL.tracker)
        assert matches and matches[0].inliers == max(m.inliers for m in matches)
        for m in matches:
            truth = inverse(room_poses()[8 * m.keyframe]) @ room_poses()[i]
            distance_m, angle_deg = pose_error(m.T_keyframe_cam, truth)
            assert distance_m < 0.01 and angle_deg < 0.3
            assert m.overlap > 0.15 and m.consistency > 0.9 and m.similarity > 0.5


def test_a_keyframe_finds_others_and_not_itself(places):
    store, index = places
    matches = find_loop(store, index, 2, SMALL.tracker)
    assert matches and all(m.keyframe != 2 for m in matches)
    only = find_loop(store, index, 2, SMALL.tracker, among=np.array([3]))
    assert [m.keyframe for m in only] == [3]
    truth = inverse(room_poses()[24]) @ room_poses()[16]
    assert pose_error(only[0].T_keyframe_cam, truth)[0] < 0.01


def test_another_room_is_not_recognised(places):
    store, index = places
    hall = replace(OPTIONS.synth, seed=7, size_m=(9.0, 8.0, 3.0))  # the same kinds of furniture
    other = replace(OPTIONS, frames=4, stride=120, synth=hall)
    frames = [f for f in open_source("synth:room", other).frames() if isinstance(f, Frame)]
    assert len(frames) == 4
    for frame in frames:
        assert find_loop(store, index, frame, SMALL.tracker, candidates=5) == []


def test_a_black_frame_and_limits_that_nothing_meets(places):
    store, index = places
    frame = room_frames()[3]
    assert find_loop(store, index, with_black(frame), SMALL.tracker) == []
    strict = LoopLimits(inliers=10_000)
    assert find_loop(store, index, frame, SMALL.tracker, limits=strict) == []
