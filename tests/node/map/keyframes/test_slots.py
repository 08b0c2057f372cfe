"""Slabs hold fewer keyframes of larger images."""

import numpy as np
import pytest

from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore


def _frame(camera: Camera, index: int) -> Frame:
    size = (camera.height_px, camera.width_px)
    color, depth_raw = np.full((*size, 3), index, np.uint8), np.full(size, index, np.uint16)
    return Frame(index, 1000 * index, camera, color, depth_raw, 5000.0)


@pytest.mark.parametrize(
    ("width_px", "height_px", "per_slab"),
    [(640, 480, 8), (640, 576, 6), (1280, 720, 2), (1920, 1080, 1)],
)
def test_images_of_any_size_keep_their_pixels(width_px: int, height_px: int, per_slab: int):
    """Also in slots that are used again, and in slots whose memory went to the system and came back."""
    arrays = MemoryAllocator()
    camera = Camera(width_px, height_px, 500.0, 500.0, width_px / 2 - 0.5, height_px / 2 - 0.5)
    store = KeyframeStore.create(arrays, camera, 5000.0, 64)
    for k in range(26):
        assert store.append(_frame(camera, k), np.eye(4)) == k
        if k >= 3:
            store.retire(k - 2, k - 3 if k == 3 else 0)
        for kept in store.kept().tolist():
            seen = store.frame(kept)
            assert (seen.color[0, 0, 0], seen.depth_raw[-1, -1]) == (kept, kept)
    assert store.kept().tolist() == [0, 24, 25]
    slots = 12  # 3 kept, 8 that rest, 1 that was retired just now
    slabs = -(-slots // per_slab)
    assert arrays.exists(f"keyframe_color.{slabs - 1:03d}")
    assert not arrays.exists(f"keyframe_color.{slabs:03d}")
