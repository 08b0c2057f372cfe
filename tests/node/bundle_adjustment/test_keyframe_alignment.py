"""What is held of keyframes that are aligned to each other."""

import pytest

from hsslam_node.bundle_adjustment.keyframe_alignment import KeyframeAlignment
from hsslam_node.geometry.camera import Camera
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from tests.small_room import SMALL


@pytest.mark.parametrize(
    ("width_px", "height_px", "most"),
    [(160, 120, 16), (640, 480, 16), (1920, 1080, 4), (3840, 2160, 2)],
)
def test_of_large_images_few_pyramids_are_held(width_px, height_px, most):
    camera = Camera(width_px, height_px, 600.0, 600.0, width_px / 2, height_px / 2)
    store = KeyframeStore.create(MemoryAllocator(), camera, 5000.0, 16)
    alignment = KeyframeAlignment(store, SMALL.tracker, SMALL.pose_graph, 0)
    assert alignment.most_pyramids == most
