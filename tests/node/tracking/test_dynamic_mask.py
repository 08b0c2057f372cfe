"""What stands where there was free space is left out, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.frame import Frame
from hsslam_node.tracking.dynamic_mask import seen_space, without_dynamic_pixels
from tests.small_room import displaced, room_frames, room_poses

BOX = np.s_[30:90, 60:100]


def _with_box(frame: Frame) -> Frame:
    """Something half as far away as the room behind it."""
    depth_raw = frame.depth_raw.copy()
    depth_raw[BOX] = depth_raw[BOX].min() // 2
    return replace(frame, depth_raw=depth_raw)


def _seen(*indices: int):
    return [(seen_space(i, room_frames()[i]), room_poses()[i]) for i in indices]


@pytest.mark.parametrize("index", [8, 20])
def test_a_static_room_is_left_as_it_is(index):
    frame = room_frames()[index]
    assert without_dynamic_pixels(frame, room_poses()[index], _seen(0, 4)) is frame
    near = displaced(room_poses()[index], 0.02, 0.5)
    assert without_dynamic_pixels(frame, near, _seen(0, 4)) is frame


def test_a_thing_that_has_come_is_left_out():
    frame = _with_box(room_frames()[8])
    still = without_dynamic_pixels(frame, room_poses()[8], _seen(0, 4))
    gone = (still.depth_raw == 0) & (frame.depth_raw > 0)
    assert gone[BOX].mean() > 0.95
    assert gone.sum() < 1.4 * gone[BOX].sum()
    kept = ~gone
    np.testing.assert_array_equal(still.depth_raw[kept], frame.depth_raw[kept])


def test_it_is_left_out_where_nobody_has_looked_too():
    """The keyframe knows free space behind its right half only."""
    known = room_frames()[4]
    depth_raw = known.depth_raw.copy()
    depth_raw[:, :75] = 0
    seen = [(seen_space(1, replace(known, depth_raw=depth_raw)), room_poses()[4])]
    frame = _with_box(room_frames()[8])
    still = without_dynamic_pixels(frame, room_poses()[8], seen)
    assert (still.depth_raw[BOX] == 0).mean() > 0.9


def test_a_wrong_pose_leaves_nothing_out():
    frame = room_frames()[8]
    near = replace(frame, depth_raw=frame.depth_raw // 2)
    assert without_dynamic_pixels(near, room_poses()[8], _seen(0, 4)) is near
    assert without_dynamic_pixels(near, room_poses()[8], []) is near
