"""The keyframe that shows most of a frame, in images of any size."""

import numpy as np
import pytest

from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import camera_points
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.tracking.keyframes.covering_keyframe import covering_keyframe, stride_px
from tests.small_room import room_frames, room_poses


@pytest.mark.parametrize(
    ("width_px", "height_px", "stride"),
    [(640, 480, 24), (160, 120, 6), (20, 15, 1), (1920, 1440, 72)],
)
def test_images_of_any_size_have_as_many_points(width_px, height_px, stride):
    camera = Camera(width_px, height_px, width_px, width_px, width_px / 2, height_px / 2)
    assert stride_px(camera) == stride
    depth_m = np.ones((height_px, width_px))
    points = camera_points(depth_m, camera, stride)
    assert len(points) == (27 * 20 if width_px > 20 else 20 * 15)


def test_it_is_the_one_that_shows_clearly_more():
    frames, poses = room_frames(), room_poses()
    store = KeyframeStore.create(
        MemoryAllocator(), frames[0].camera, frames[0].depth_units_per_m, 8
    )
    for k in (0, 20, 39):
        store.append(frames[k], poses[k])
    assert covering_keyframe(store, frames[38], poses[38], current=0) == 2
    assert covering_keyframe(store, frames[38], poses[38], current=2) == 2
