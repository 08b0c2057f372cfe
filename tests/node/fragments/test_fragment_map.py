"""The map of a fragment that has not joined: keyframes without a fitted field."""

import numpy as np
import pytest

from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.errors import UserError
from hsslam_node.fragments.fragment import Fragment
from hsslam_node.fragments.fragment_map import fragment_map
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.checkpoint import load_checkpoint, save_checkpoint
from hsslam_node.map.restore import restore_map, saved_frames
from tests.small_room import SMALL, room_frames, room_poses


@pytest.fixture(scope="module")
def fragment():
    fragment = Fragment(SMALL, room_frames()[0], 0, 1, 8)
    for frame, T in zip(room_frames()[:5], room_poses()[:5], strict=True):
        fragment.store.append(frame, T)
    fragment.store.retire(1, 0)
    return fragment


@pytest.fixture(scope="module")
def path(fragment, tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "map_fragment_1.safetensors"
    save_checkpoint(path, fragment_map(fragment, SMALL))
    return path


def test_its_file_has_the_kept_keyframes_and_no_field(fragment, path):
    saved, kept = load_checkpoint(path), fragment.store.kept()
    assert not saved.is_fitted and saved.step == 0
    np.testing.assert_array_equal(saved.T_world_keyframe, fragment.store.poses_of(kept))
    assert saved.keyframe_stamps_ns.tolist() == fragment.store.stamps_ns()[kept].tolist()
    for frame, k in zip(saved_frames(path, saved), kept, strict=True):
        np.testing.assert_array_equal(frame.depth_raw, fragment.store.frame(k).depth_raw)
    assert path.stat().st_size < saved.params.nbytes / 10


def test_what_needs_a_surface_refuses_it(path):
    told = rf"{path}: keyframes of a fragment, without a surface: expected a map; hsslam-map merge adds"
    with pytest.raises(UserError, match=told):
        SavedMap.open(path, "cpu")
    with pytest.raises(UserError, match=told):
        restore_map(MemoryAllocator(), path, SMALL)
