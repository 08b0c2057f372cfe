"""The keyframe that shows the same view comes first, whatever the light."""

import numpy as np
import pytest

from hsslam_node.keyframes.allocator import MemoryAllocator
from hsslam_node.keyframes.store import KeyframeStore
from hsslam_node.tracking.place_recognition import PlaceRecognition
from tests.small_room import room_frames


@pytest.fixture
def store() -> KeyframeStore:
    first = room_frames()[0]
    return KeyframeStore.create(MemoryAllocator(), first.camera, first.depth_units_per_m, 64)


def test_an_empty_store_is_like_nothing(store):
    assert PlaceRecognition(store).nearest(room_frames()[0].color, 3) == []


def test_the_same_view_comes_first(store):
    frames = room_frames()[::5]
    for frame in frames:
        store.append(frame, np.eye(4))
    places = PlaceRecognition(store)
    for k, frame in enumerate(frames):
        nearest = places.nearest(frame.color, 3)
        assert nearest[0] == k and len(set(nearest)) == 3
        darker = (frame.color * 0.6).astype(np.uint8)
        assert places.nearest(darker, 1) == [k]
    assert len(places.nearest(frames[0].color, 100)) == len(frames)


def test_keyframes_that_come_later_are_known(store):
    frames = room_frames()
    store.append(frames[0], np.eye(4))
    places = PlaceRecognition(store)
    assert places.nearest(frames[30].color, 1) == [0]
    store.append(frames[30], np.eye(4))
    assert places.nearest(frames[31].color, 1) == [1]


def test_a_black_image_is_no_trouble(store):
    store.append(room_frames()[0], np.eye(4))
    assert PlaceRecognition(store).nearest(np.zeros_like(room_frames()[0].color), 1) == [0]
