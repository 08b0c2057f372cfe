"""A camera that stands still: keyframes come until there are enough, and again if the view changes."""

import numpy as np
import pytest

from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.place_recognition.still_camera import StillCamera
from tests.small_room import room_frames

_ENOUGH = 3
_SHAPE = 60, 80
_GREY = np.full(_SHAPE, 100.0, np.float32)
_WALL = np.full(_SHAPE, 2.0, np.float32)


@pytest.fixture
def still() -> StillCamera:
    """That has enough keyframes of a grey wall."""
    first = room_frames()[0]
    store = KeyframeStore.create(MemoryAllocator(), first.camera, first.depth_units_per_m, 8)
    camera = StillCamera(store, _ENOUGH)
    for _ in range(_ENOUGH):
        assert not camera.has_enough(np.eye(4), _GREY, _WALL)
        store.append(first, np.eye(4))
    return camera


def _with(depth_m: float, rows: slice, columns: slice) -> np.ndarray:
    """The wall with a board before or behind it."""
    changed = _WALL.copy()
    changed[rows, columns] = depth_m
    return changed


def test_the_same_view_is_enough(still):
    rng = np.random.default_rng(0)
    for _ in range(10):
        noise = rng.normal(size=(2, *_SHAPE)).astype(np.float32)
        assert still.has_enough(np.eye(4), _GREY + 5 * noise[0], _WALL + 0.01 * noise[1])


@pytest.mark.parametrize("depth_m", [1.0, 1.8, 2.2])
def test_what_is_put_there_in_the_colour_of_the_wall_is_a_new_view(still, depth_m):
    box = _with(depth_m, slice(20, 32), slice(30, 42))  # 3 % of the image
    assert not still.has_enough(np.eye(4), _GREY, box)


def test_edges_and_holes_that_flicker_are_no_new_view(still):
    edge = _with(1.0, slice(None), slice(30, 32))
    assert still.has_enough(np.eye(4), _GREY, edge)
    assert still.has_enough(np.eye(4), _GREY, _with(0.0, slice(20, 40), slice(30, 60)))


def test_another_light_is_a_new_view(still):
    assert not still.has_enough(np.eye(4), _GREY + 10, _WALL)
