"""A fragment and a map that has no room for its keyframes."""

import numpy as np

from hsslam_node.fragments.fragment import Fragment
from hsslam_node.fragments.joining import Joining
from hsslam_node.geometry.se3 import se3_exp
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


def test_covariances_are_turned_into_the_axes_of_the_map():
    frames = room_frames()
    store = KeyframeStore.create(
        MemoryAllocator(), frames[0].camera, frames[0].depth_units_per_m, 4
    )
    store.append(frames[0], np.eye(4))
    fragment = Fragment(SMALL, frames[0], 0, 1, 8)
    unsure_along_x = np.diag([1.0, *5 * [1e-6]])
    fragment.store.append(frames[1], np.eye(4), covariance=unsure_along_x)
    quarter_turn_about_z = se3_exp(np.array([1, 2, 3, 0, 0, np.pi / 2]))
    joined = Joining(fragment, store, quarter_turn_about_z, 4).finish()
    assert joined is not None
    sigmas_m = np.sqrt(np.diag(store.covariance(int(joined.keyframes[0]))))[:3]
    np.testing.assert_allclose(sigmas_m, [0.02, 1.0, 0.02], atol=1e-3)
