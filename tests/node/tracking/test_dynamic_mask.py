"""What stands where there was free space is left out, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
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


@pytest.mark.parametrize(("turns", "flip"), [(0, False), (0, True), (1, False), (1, True)])
def test_a_thing_at_one_border_leaves_out_no_surface_at_the_opposite_border(turns, flip):
    """A thing at one border comes where there was free space; a wall as far away opposite to it is new."""
    known = np.full((96, 96), 3000, np.uint16)
    now = known.copy()
    now[30:70, :12] = now[:, 72:] = 2000
    known[:, 72:] = 0

    def frame(depth_raw: np.ndarray) -> Frame:
        depth_raw = np.rot90(depth_raw[:, ::-1] if flip else depth_raw, turns)
        camera = Camera(96, 96, 100.0, 100.0, 47.5, 47.5)
        color = np.zeros((96, 96, 3), np.uint8)
        return Frame(1, 1, camera, color, np.ascontiguousarray(depth_raw), 1000.0)

    seen = [(seen_space(0, frame(known)), np.eye(4))]
    before = frame(now)
    after = without_dynamic_pixels(before, np.eye(4), seen)
    gone = np.rot90((after.depth_raw == 0) & (before.depth_raw > 0), -turns)
    gone = gone[:, ::-1] if flip else gone
    assert gone[30:70, :12].mean() > 0.8 and not gone[:, 72:].any()
