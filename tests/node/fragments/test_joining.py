"""A fragment and a map that has no room for its keyframes."""

import numpy as np

from hsslam_node.fragments.fragment import Fragment
from hsslam_node.fragments.joining import Joining
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from tests.small_room import SMALL, room_frames


def test_a_fragment_goes_on_until_the_map_has_memory_for_it():
    first = room_frames()[0]
    store = KeyframeStore.create(MemoryAllocator(), first.camera, first.depth_units_per_m, 4)
    store.append(first, np.eye(4))
    store.allow(1)
    fragment = Fragment(SMALL, first, 0, 1, 8)
    fragment.track(first)
    joining = Joining(fragment, store, np.eye(4), 1)
    assert [joining.step() for _ in range(4)] == [None] * 4
    assert joining.finish() is None and store.count == 1
    store.allow(4)
    assert joining.finish() is not None and store.count == 2
