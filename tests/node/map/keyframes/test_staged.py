"""Pixels that lie in a store before their keyframes are shown."""

import numpy as np
import pytest

from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.keyframes.slots import SLAB_KEYFRAMES
from hsslam_node.map.keyframes.staged import StagedKeyframes
from hsslam_node.map.store import KeyframeStore
from tests.small_room import room_frames, room_poses

_STAGED = SLAB_KEYFRAMES + 2


def _store(capacity: int = 64) -> KeyframeStore:
    """With the first frame as its keyframe."""
    first = room_frames()[0]
    store = KeyframeStore.create(MemoryAllocator(), first.camera, first.depth_units_per_m, capacity)
    store.append(first, room_poses()[0])
    return store


def _staged(store: KeyframeStore) -> StagedKeyframes:
    """The frames after the first."""
    staged = store.staging()
    assert all(staged.add(frame) for frame in room_frames()[1 : 1 + _STAGED])
    return staged


def _expect_frames(store: KeyframeStore, count: int) -> None:
    assert store.kept().tolist() == list(range(count))
    for k, expected in enumerate(room_frames()[:count]):
        np.testing.assert_array_equal(store.frame(k).color, expected.color)
        np.testing.assert_array_equal(store.frame(k).depth_raw, expected.depth_raw)
        assert store.frame(k).index == expected.index


def test_they_are_seen_all_at_once():
    store = _store()
    staged = _staged(store)
    _expect_frames(store, 1)
    sure = np.zeros((_STAGED, 6, 6))
    ids = store.append_staged(staged, room_poses()[1 : 1 + _STAGED], sure, sure, 3)
    assert ids.tolist() == list(range(1, 1 + _STAGED))
    assert store.append(room_frames()[1 + _STAGED], room_poses()[1 + _STAGED]) == 1 + _STAGED
    _expect_frames(store, 2 + _STAGED)
    np.testing.assert_array_equal(store.poses(), room_poses()[: 2 + _STAGED])
    assert store.fragments().tolist() == [0, *[3] * _STAGED, 0]


@pytest.mark.parametrize("has_died", [False, True])
def test_the_slots_of_those_that_do_not_come_are_used_again(has_died):
    store = _store(capacity=1 + _STAGED)
    staged = _staged(store)
    assert not staged.add(room_frames()[0])  # there is no room
    if has_died:
        store.forget_incomplete()
    else:
        staged.give_up()
    for k in range(1, 1 + _STAGED):
        assert store.append(room_frames()[k], room_poses()[k]) == k
    _expect_frames(store, 1 + _STAGED)
