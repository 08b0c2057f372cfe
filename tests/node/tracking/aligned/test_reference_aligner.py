"""The reference keyframe of a tracker whose keyframes another process removes meanwhile."""

import numpy as np

from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.tracking.aligned.reference_aligner import ReferenceAligner
from tests.small_room import SMALL, room_frames, room_poses


def _at_first_of_three() -> tuple[ReferenceAligner, KeyframeStore]:
    """An aligner that refers to the first of the keyframes at frames 0, 10 and 20."""
    frames = room_frames()
    first = frames[0]
    store = KeyframeStore.create(MemoryAllocator(), first.camera, first.depth_units_per_m, 8)
    for k in (0, 10, 20):
        store.append(frames[k], room_poses()[k])
    aligner = ReferenceAligner(SMALL.tracker, store)
    aligner.refer_to(0)
    return aligner, store


def test_the_reference_stays_if_the_keyframe_that_shows_more_is_removed_meanwhile(monkeypatch):
    aligner, store = _at_first_of_three()
    frames = room_frames()
    aligner.refer_next_to_covering(frames[11], room_poses()[11])
    store.retire(1, 2)
    aligner.prepare_next()
    assert aligner.keyframe == 0

    def removed_after_the_choice(store, frame, T_world_cam, before) -> int:
        return 1

    module = "hsslam_node.tracking.aligned.reference_aligner.covering_keyframe"
    monkeypatch.setattr(module, removed_after_the_choice)
    aligner.refer_to_covering(frames[11], room_poses()[11])
    assert aligner.keyframe == 0
    monkeypatch.undo()
    aligner.refer_to_covering(frames[21], room_poses()[21])
    assert aligner.keyframe == 2
    np.testing.assert_array_equal(store.kept(), [0, 2])


def test_a_reference_that_replaces_one_at_a_place_found_again_is_no_more_tracked_to():
    aligner, _ = _at_first_of_three()
    frames = room_frames()
    aligner.refer_to_covering(frames[11], room_poses()[11])
    assert (aligner.keyframe, aligner.take_untracked()) == (1, False)
    aligner.refer_to(0)
    aligner.refer_next_to_covering(frames[11], room_poses()[11])
    aligner.prepare_next()
    aligner.refer_to_covering(frames[21], room_poses()[21])
    assert (aligner.keyframe, aligner.take_untracked()) == (2, True)
    assert not aligner.take_untracked()
