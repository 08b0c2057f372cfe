"""What was not expected must be borne out by the images."""

from dataclasses import replace

import numpy as np

from hsslam_node.tracking.aligned.acceptance import is_confirmed
from hsslam_node.tracking.tracked_frame import TrackedFrame
from tests.small_room import displaced, room_frames, room_poses, with_black

LAST = TrackedFrame(room_frames()[0], 0, np.eye(4))


def _is_confirmed(T, prediction, frame) -> bool:
    return is_confirmed(T, prediction, frame, LAST, room_poses()[0], 0.5)


def test_the_expected_is_believed_whatever_the_image_shows():
    T = room_poses()[1]
    assert _is_confirmed(T, displaced(T, 0.02, 1.0), with_black(room_frames()[1]))


def test_a_true_jerk_is_believed():
    T = room_poses()[6]
    assert _is_confirmed(T, displaced(T, 0.1, 6.0), room_frames()[6])


def test_a_pose_that_the_images_contradict_is_not():
    T = room_poses()[6]
    for frame, wrong in ((room_frames()[6], displaced(T, 0.14, 8.0)), (room_frames()[39], T)):
        assert not _is_confirmed(wrong, displaced(wrong, 0.1, 6.0), frame)
    assert not _is_confirmed(T, displaced(T, 0.1, 6.0), with_black(room_frames()[6]))


def test_after_a_gap_nothing_is_expected_and_the_images_must_agree():
    T = room_poses()[6]
    assert _is_confirmed(T, None, room_frames()[6])
    assert not _is_confirmed(T, None, with_black(room_frames()[6]))
    assert not _is_confirmed(displaced(T, 0.1, 2.0), None, room_frames()[6])


def test_images_without_contrast_confirm_only_what_was_seen_just_before():
    """In the dark a wall can be laid on itself, shifted: a camera may have been carried along it."""
    dark = replace(room_frames()[1], color=np.zeros_like(room_frames()[1].color))
    T, near = room_poses()[1], displaced(room_poses()[0], 0.02, 1.0)
    assert _is_confirmed(T, None, dark) and _is_confirmed(near, None, dark)
    late = replace(dark, stamp_ns=dark.stamp_ns + 10**9)
    assert not _is_confirmed(T, None, late) and not _is_confirmed(near, None, late)
    assert _is_confirmed(T, T, late)  # as predicted
