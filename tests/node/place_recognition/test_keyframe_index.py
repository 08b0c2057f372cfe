"""The index takes in what is new and finds the keyframe that shows the same."""

import numpy as np
import pytest

from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.place_recognition.image_features import image_features
from hsslam_node.place_recognition.keyframe_index import KeyframeIndex
from tests.small_room import room_frames, with_black


@pytest.fixture
def store() -> KeyframeStore:
    first = room_frames()[0]
    return KeyframeStore.create(MemoryAllocator(), first.camera, first.depth_units_per_m, 64)


def _apart(k: int) -> np.ndarray:
    return se3_exp(np.array([float(k), 0, 0, 0, 0, 0]))


def test_the_keyframe_that_shows_the_same_comes_first(store):
    frames = room_frames()[::8]
    for k, frame in enumerate(frames):
        store.append(frame, _apart(k))
    index = KeyframeIndex(store)
    assert index.update() == len(index) == len(frames) and index.is_complete
    for k, frame in enumerate(frames):
        features = image_features(frame)
        found = index.similar(features, 3)
        assert found[0][0] == k and len({i for i, _ in found}) == 3
        assert [v for _, v in found] == sorted((v for _, v in found), reverse=True)
        allowed = np.array([i for i in range(len(frames)) if i != k])
        assert k not in [i for i, _ in index.similar(features, 3, allowed)]
    assert index.similar(image_features(room_frames()[1]), 1)[0][0] == 0


def test_a_few_at_a_time_are_the_same_in_the_end(store):
    for k, frame in enumerate(room_frames()[::2]):  # more than one growth of the table
        store.append(frame, _apart(k))
    index, at_once = KeyframeIndex(store), KeyframeIndex(store)
    at_once.update()
    while not index.is_complete:
        assert index.update(3) <= 3
    features = image_features(room_frames()[17])
    assert index.similar(features, 20) == at_once.similar(features, 20)
    store.append(room_frames()[39], _apart(50))
    assert not index.is_complete
    assert index.update(3) == 1 and 20 in index.keyframes


def test_the_newest_are_taken_in_first_where_that_is_wanted(store):
    for k in range(4):
        store.append(room_frames()[k], _apart(k))
    index = KeyframeIndex(store)
    assert index.update(2, newest_first=True) == 2 and index.keyframes.tolist() == [3, 2]
    store.append(room_frames()[4], _apart(4))
    assert index.update(1, newest_first=True) == 1 and index.keyframes.tolist() == [3, 2, 4]
    assert index.update() == 2 and index.is_complete
    features = image_features(room_frames()[1])
    assert index.similar(features, 1, np.array([1]))[0][0] == 1


def test_what_has_been_seen_from_there_is_left_out(store):
    frame = room_frames()[0]
    near, turned = np.eye(4), se3_exp(np.array([0, 0, 0, 0, 0.5, 0]))
    near[0, 3] = 0.1
    for T in (np.eye(4), near, turned, turned, _apart(1)):
        store.append(frame, T)
    index = KeyframeIndex(store)
    index.update()
    assert index.keyframes.tolist() == [0, 2, 4]
    assert len(index.features(1)) == len(index.features(0))  # there on demand


def test_a_retired_keyframe_goes_and_one_that_it_stood_for_comes(store):
    frames = room_frames()
    for k, T in enumerate((np.eye(4), np.eye(4), _apart(1), _apart(2))):
        store.append(frames[4 * k], T)
    index = KeyframeIndex(store)
    assert index.update() == 3 and index.keyframes.tolist() == [0, 2, 3]
    store.retire(0, 1)
    store.retire(3, 2)
    features = image_features(frames[12])
    assert index.update() == 1 and index.keyframes.tolist() == [2, 1]
    assert {k for k, _ in index.similar(features, 4)} <= {1, 2}
    fresh = KeyframeIndex(store)
    fresh.update()
    assert index.similar(features, 4) == sorted(
        ((k, v) for k, v in fresh.similar(features, 4)), key=lambda kv: -kv[1]
    )


def test_a_dark_keyframe_keeps_none_out_that_shows_its_view_in_the_light(store):
    for frame in (with_black(room_frames()[0]), room_frames()[0], room_frames()[0]):
        store.append(frame, np.eye(4))
    index = KeyframeIndex(store)
    index.update()
    assert index.keyframes.tolist() == [0, 1]
    assert [k for k, _ in index.similar(image_features(room_frames()[1]), 3)] == [1]


def test_nothing_is_like_nothing(store):
    black = image_features(with_black(room_frames()[0]))
    index = KeyframeIndex(store)
    assert index.update() == 0 and index.similar(black, 3) == []
    store.append(with_black(room_frames()[0]), np.eye(4))
    store.append(room_frames()[0], _apart(1))
    index.update()
    assert index.similar(black, 3) == []
    assert [k for k, _ in index.similar(image_features(room_frames()[1]), 3)] == [1]
