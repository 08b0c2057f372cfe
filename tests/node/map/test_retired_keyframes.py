"""Keyframes that are retired: their slots are used again, their poses move with an anchor."""

import threading
import time

import numpy as np
import pytest

from hsslam_node.errors import OutOfMemoryError, UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import inverse, se3_exp
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.keyframes.row_slabs import SLAB_ROWS
from hsslam_node.map.keyframes.slots import SLAB_KEYFRAMES
from hsslam_node.map.pose_correction import PoseCorrection
from hsslam_node.map.store import KeyframeStore, RetiredKeyframeError

CAMERA = Camera(8, 6, 7.0, 7.5, 3.5, 2.5)


class FullMemory(MemoryAllocator):
    """Refuses to make more slabs of pixels than it is allowed."""

    slabs = 1

    def create(self, name, shape, dtype):
        number = name.partition("keyframe_color.")[2]
        if number and int(number) >= self.slabs:
            raise OutOfMemoryError(f"array {name}: full")
        return super().create(name, shape, dtype)


def _frame(index: int) -> Frame:
    color = np.full((6, 8, 3), index % 256, np.uint8)
    return Frame(index, 1000 * index, CAMERA, color, np.full((6, 8), index, np.uint16), 5000.0)


def _pose(k: int) -> np.ndarray:
    return se3_exp(np.random.default_rng(k).normal(size=6))


def _store(count: int, arrays: MemoryAllocator, capacity: int = 64) -> KeyframeStore:
    store = KeyframeStore.create(arrays, CAMERA, 5000.0, capacity)
    for k in range(count):
        store.append(_frame(k), _pose(k))
    return store


def _shown(store: KeyframeStore, k: int) -> int:
    return int(store.frame(k).depth_raw[0, 0])


def test_a_retired_keyframe_has_a_pose_and_no_pixels():
    arrays = MemoryAllocator()
    store = _store(5, arrays)
    store.retire(2, 4)
    for each in (store, KeyframeStore(arrays)):  # in every process
        assert each.kept().tolist() == [0, 1, 3, 4] and each.count == 5 and not each.is_kept(2)
        np.testing.assert_array_equal(each.pose(2), _pose(2))
        assert each.stamps_ns().tolist() == [0, 1000, 2000, 3000, 4000]
        with pytest.raises(RetiredKeyframeError):
            each.frame(2)
    with pytest.raises(ValueError, match="keyframe 2 is not kept"):
        store.retire(2, 1)


def test_slots_are_used_again_after_a_rest():
    arrays = MemoryAllocator()
    store = _store(SLAB_KEYFRAMES, arrays)
    store.retire(3, 2)
    for k in range(SLAB_KEYFRAMES, 40):
        store.append(_frame(k), _pose(k))
        store.retire(k - 3, 2)
        assert all(_shown(store, int(i)) == i for i in store.kept())
    assert not arrays.exists(
        "keyframe_color.003"
    )  # 9 kept, 8 that rest, 1 that was retired just now
    assert store.kept().tolist() == [0, 1, 2, 4, 37, 38, 39]


def test_it_moves_with_its_anchor_and_with_the_anchor_of_that():
    store = _store(8, MemoryAllocator())
    store.retire(2, 5)
    store.retire(5, 6)
    before, move = store.poses(), _pose(100)
    correction = store.correct_poses(np.array([6]), (move @ before[6])[None])
    assert correction.keyframes.tolist() == [2, 5, 6]
    np.testing.assert_allclose(store.poses()[[2, 5, 6]], move @ before[[2, 5, 6]], atol=1e-12)
    np.testing.assert_array_equal(store.poses()[[0, 1, 3, 4, 7]], before[[0, 1, 3, 4, 7]])
    np.testing.assert_array_equal(store.poses_of(correction.keyframes), correction.T_world_cam)


def test_what_comes_while_a_correction_is_computed_moves_along():
    store = _store(6, MemoryAllocator())
    known, move = store.count, _pose(100)
    store.append(_frame(6), _pose(6))
    store.append(_frame(7), _pose(7))
    before = store.poses()
    store.correct_poses(np.array([4, 5]), move @ before[[4, 5]], known)
    np.testing.assert_allclose(store.poses()[4:], move @ before[4:], atol=1e-12)
    np.testing.assert_array_equal(store.poses()[:4], before[:4])


def test_what_comes_while_it_is_written_moves_along():
    """The tracker appends, at a pose of before, between the count and the new version."""
    store = _store(6, MemoryAllocator())
    before, move = store.poses(), _pose(100)
    write_bank = store._rows.write_bank

    def append_meanwhile(poses: np.ndarray, bank: int) -> None:
        write_bank(poses, bank)
        if store.count == 6:
            store.append(_frame(6), _pose(6))

    store._rows.write_bank = append_meanwhile
    correction = store.correct_poses(np.array([5]), (move @ before[5])[None], 6)
    assert correction.keyframes.tolist() == [5, 6] and correction.version == store.pose_version
    np.testing.assert_allclose(
        inverse(store.pose(5)) @ store.pose(6), inverse(before[5]) @ _pose(6)
    )


def test_a_tracker_that_died_between_slot_and_count_is_followed_by_another():
    arrays = MemoryAllocator()
    store = _store(5, arrays)
    arrays.open("keyframe_slots")[5] = 6  # keyframe 5 has a slot, and was never complete
    assert store.kept().tolist() == [0, 1, 2, 3, 4]
    successor = KeyframeStore.create(arrays, CAMERA, 5000.0, 64)
    assert successor.append(_frame(50), _pose(5)) == 5
    assert successor.kept().tolist() == [0, 1, 2, 3, 4, 5] and _shown(successor, 5) == 50


def test_full_memory_is_answered_with_slots_of_retired_ones():
    store = _store(SLAB_KEYFRAMES, FullMemory())
    assert not store.has_room() and store.room.refused == 1
    with pytest.raises(OutOfMemoryError, match=r"keyframe_color\.001"):
        store.append(_frame(8), _pose(8))
    store.retire(4, 0)
    assert store.has_room() and store.room.refused == 1
    assert store.append(_frame(8), _pose(8)) == 8 and _shown(store, 8) == 8


def test_no_more_are_kept_than_allowed():
    store = _store(8, MemoryAllocator())
    store.room.allow(9)
    assert store.has_room() and store.room.most_kept == 9
    store.append(_frame(8), _pose(8))
    assert not store.has_room()
    with pytest.raises(UserError, match=r"keyframes\.capacity"):
        store.append(_frame(9), _pose(9))


def test_the_number_of_keyframes_has_no_limit():
    arrays = MemoryAllocator()
    store = _store(2, arrays, capacity=16)
    for k in range(2, SLAB_ROWS + 10):
        store.append(_frame(k), np.eye(4))
        store.retire(k - 1, 0)
    assert store.count == SLAB_ROWS + 10 and store.kept().tolist() == [0, SLAB_ROWS + 9]
    moved = se3_exp(np.full(6, 0.1))
    store.correct_poses(np.array([0]), moved[None])
    reader = KeyframeStore(arrays)
    np.testing.assert_allclose(reader.pose(SLAB_ROWS + 3), moved @ inverse(_pose(0)), atol=1e-12)
    ids = np.array([SLAB_ROWS + 9, 3, SLAB_ROWS])
    np.testing.assert_array_equal(reader.poses_of(ids), reader.poses()[ids])
    assert reader.frame_indices()[-1] == SLAB_ROWS + 9


class FullRows(MemoryAllocator):
    """Refuses to make rows of keyframes."""

    def create(self, name, shape, dtype):
        if name.startswith("keyframe_meta."):
            raise OutOfMemoryError(f"array {name}: full")
        return super().create(name, shape, dtype)


def test_without_memory_for_rows_there_is_no_room_and_no_error():
    store = _store(0, FullRows())
    assert not store.has_room() and store.room.refused == 1 and store.count == 0


@pytest.mark.parametrize("held_s", [0.0, 0.3])  # of a tracker that waits for a core
def test_a_correction_waits_for_the_keyframe_that_is_being_appended(held_s):
    store = _store(3, MemoryAllocator())
    before, wanted, new = store.pose(2), _pose(10), _pose(3)
    corrections: list[PoseCorrection] = []

    def correct() -> None:
        corrections.append(store.correct_poses(np.array([2]), wanted[None], known=3))

    thread = threading.Thread(target=correct)
    with store.appending():
        version = store.pose_version
        thread.start()
        while store.pose_version == version:
            time.sleep(0.001)
        time.sleep(held_s)
        store.append(_frame(3), new, version)
    thread.join(10)
    np.testing.assert_allclose(store.pose(3), wanted @ inverse(before) @ new, atol=1e-12)
    assert corrections[0].keyframes.tolist() == [2, 3]


def _moved_by(T: np.ndarray, *ids: int) -> dict[int, np.ndarray]:
    return {k: T @ _pose(k) for k in ids}


@pytest.mark.parametrize("while_written", [False, True])
def test_keyframes_that_come_during_a_correction_move_with_those_they_were_aligned_to(
    while_written,
):
    """3 goes on from 2, 4 was found again beside 0, and 5 goes on from there."""
    store = _store(3, MemoryAllocator())
    T = se3_exp(np.full(6, 0.1))

    def append() -> None:
        store.append(_frame(3), _pose(3), 0)
        store.append(_frame(4), _pose(4), 0, reference=0)
        store.append(_frame(5), _pose(5), 0)

    def correct() -> None:
        store.correct_poses(np.arange(1, 3), T @ store.poses_of(np.arange(1, 3)), known=3)

    if while_written:
        thread = threading.Thread(target=correct)
        with store.appending():
            thread.start()
            while store.pose_version == 0:
                time.sleep(0.001)
            append()
        thread.join(10)
    else:
        append()
        correct()
    expected = {k: _pose(k) for k in (0, 4, 5)} | _moved_by(T, 1, 2, 3)
    for k, pose in expected.items():
        np.testing.assert_allclose(store.pose(k), pose, atol=1e-12, err_msg=str(k))


def test_keyframes_of_a_fragment_that_joins_during_a_correction_stay():
    store = _store(3, MemoryAllocator())
    staging = store.staging()
    for k in (3, 4):
        assert staging.add(_frame(k))
    gaps = np.zeros((2, 6, 6))
    store.append_staged(staging, np.stack([_pose(3), _pose(4)]), gaps, gaps, 1)
    store.append(_frame(5), _pose(5), fragment=1)
    store.correct_poses(np.array([2]), _pose(10)[None], known=3)
    for k in (3, 4, 5):
        np.testing.assert_array_equal(store.pose(k), _pose(k))


def test_a_keyframe_whose_reference_retired_for_it_during_a_correction_moves_with_it():
    store = _store(3, MemoryAllocator())
    store.append(_frame(3), _pose(3))
    store.retire(2, 3)
    T = se3_exp(np.full(6, 0.1))
    store.correct_poses(np.array([2]), (T @ _pose(2))[None], known=3)
    for k in (2, 3):
        np.testing.assert_allclose(store.pose(k), T @ _pose(k), atol=1e-12)


@pytest.mark.alone
def test_a_tracker_that_died_while_it_appended_is_waited_for_once():
    store = _store(3, MemoryAllocator())
    store.appending().__enter__()  # it never leaves
    for _ in range(20):
        store.correct_poses(np.array([2]), _pose(10)[None], known=3)
    start_s = time.monotonic()
    store.correct_poses(np.array([2]), _pose(11)[None], known=3)
    assert time.monotonic() - start_s < 0.1
