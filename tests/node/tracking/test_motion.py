"""Where the next frame is expected: by the last motion, not after a loss, a gap or a carry."""

import numpy as np
import pytest

from hsslam_node.geometry.se3 import inverse
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.tracking.motion import CameraMotion
from tests.small_room import SMALL, displaced, pose_error, room_frames, room_poses

FRAMES, POSES = room_frames(), room_poses()
PERIOD_NS = FRAMES[1].stamp_ns - FRAMES[0].stamp_ns


@pytest.fixture
def store() -> KeyframeStore:
    first = FRAMES[0]
    store = KeyframeStore.create(MemoryAllocator(), first.camera, first.depth_units_per_m, 4)
    store.append(first, POSES[0])
    return store


@pytest.fixture
def motion(store: KeyframeStore) -> CameraMotion:
    """Of a camera whose frames 0 to 2 are aligned to keyframe 0."""
    motion = CameraMotion(SMALL.tracker, store)
    assert not motion.has_begun
    motion.begin(FRAMES[0], 0)
    for k in (1, 2):
        motion.aligned(FRAMES[k], POSES[k], 0, POSES[k])
    return motion


def test_a_camera_may_be_elsewhere_if_it_is_lost_or_was_not_seen_for_long(motion):
    last_ns = FRAMES[2].stamp_ns
    assert not motion.may_be_elsewhere(last_ns + 1_000_000_000)
    assert motion.may_be_elsewhere(last_ns + 2_000_000_000)
    motion.unaligned(is_lost=True)
    assert motion.may_be_elsewhere(last_ns + PERIOD_NS)


def test_the_last_motion_goes_on(motion):
    stamp_ns = FRAMES[3].stamp_ns
    assert motion.is_foreseen(stamp_ns) and not motion.is_after_gap(stamp_ns)
    step = inverse(POSES[1]) @ POSES[2]
    np.testing.assert_allclose(motion.predicted(stamp_ns), POSES[2] @ step, atol=1e-9)
    assert pose_error(motion.predicted(stamp_ns), POSES[3])[0] < 0.002


def test_the_prediction_follows_a_correction_of_the_keyframe(motion, store):
    before = motion.predicted(FRAMES[3].stamp_ns)
    moved = displaced(POSES[0], 0.1, 5.0)
    store.correct_poses(np.array([0]), moved[None])
    expected = moved @ inverse(POSES[0]) @ before
    np.testing.assert_allclose(motion.predicted(FRAMES[3].stamp_ns), expected, atol=1e-9)


def test_a_camera_that_begins_is_at_rest(store):
    motion = CameraMotion(SMALL.tracker, store)
    motion.begin(FRAMES[0], 0)
    assert motion.is_foreseen(FRAMES[1].stamp_ns) and not motion.is_known
    np.testing.assert_array_equal(motion.predicted(FRAMES[1].stamp_ns), POSES[0])
    late_ns = FRAMES[0].stamp_ns + round(1e9 * SMALL.tracker.longest_gap_s) + 10**6
    assert not motion.is_foreseen(late_ns)
    motion.unaligned(is_lost=True)
    assert not motion.is_foreseen(FRAMES[2].stamp_ns)


def test_after_a_gap_nothing_is_foreseen(motion):
    late_ns = FRAMES[2].stamp_ns + 5 * PERIOD_NS
    assert not motion.is_foreseen(late_ns)
    longest_ns = FRAMES[2].stamp_ns + round(1e9 * SMALL.tracker.longest_gap_s)
    assert not motion.is_after_gap(longest_ns) and motion.is_after_gap(longest_ns + 10**6)


@pytest.mark.parametrize("is_carried", [False, True])
def test_the_way_of_a_camera_that_was_lost_or_carried_is_no_motion(motion, is_carried):
    if is_carried:
        motion.note_carried()
    else:
        motion.unaligned(is_lost=True)
    assert motion.lost_frames == 1 and motion.is_after_gap(FRAMES[3].stamp_ns)
    T = displaced(POSES[3], 0.5, 20.0)
    motion.aligned(FRAMES[3], T, 0, T)
    assert motion.lost_frames == 0 and not motion.is_known
    np.testing.assert_allclose(motion.predicted(FRAMES[4].stamp_ns), T, atol=1e-9)
    motion.aligned(FRAMES[4], POSES[4], 0, POSES[4])
    assert motion.is_known and motion.is_foreseen(FRAMES[5].stamp_ns)


def test_a_frame_by_odometry_alone_is_not_lost_and_ends_the_motion(motion):
    motion.unaligned(is_lost=False)
    assert motion.lost_frames == 0 and not motion.is_known
    assert not motion.is_foreseen(FRAMES[3].stamp_ns)
    np.testing.assert_allclose(motion.predicted(FRAMES[3].stamp_ns), POSES[2], atol=1e-9)
