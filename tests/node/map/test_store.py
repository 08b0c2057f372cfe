"""Keyframes survive slabs, attachment and concurrent correction."""

import contextlib
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.errors import OutOfMemoryError, UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import inverse, se3_exp
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.keyframes.slots import SLAB_KEYFRAMES
from hsslam_node.map.store import KeyframeStore

CAMERA = Camera(8, 6, 7.0, 7.5, 3.5, 2.5)


def _frame(index: int) -> Frame:
    rng = np.random.default_rng(index)
    color = rng.integers(0, 256, (6, 8, 3)).astype(np.uint8)
    depth = rng.integers(0, 60000, (6, 8)).astype(np.uint16)
    return Frame(index, 1000 * index, CAMERA, color, depth, 5000.0)


def _pose(k: int) -> np.ndarray:
    return se3_exp(np.random.default_rng(k).normal(size=6))


def _filled(count: int, capacity: int = 256) -> tuple[MemoryAllocator, KeyframeStore]:
    arrays = MemoryAllocator()
    store = KeyframeStore.create(arrays, CAMERA, 5000.0, capacity)
    assert [store.append(_frame(3 * k), _pose(k)) for k in range(count)] == list(range(count))
    return arrays, store


def _check(store: KeyframeStore, count: int) -> None:
    assert store.count == count
    assert store.frame_indices().tolist() == [3 * k for k in range(count)]
    assert store.stamps_ns().tolist() == [3000 * k for k in range(count)]
    np.testing.assert_array_equal(store.poses(), [_pose(k) for k in range(count)])
    for k in {0, SLAB_KEYFRAMES - 1, SLAB_KEYFRAMES, count - 1}:
        frame, expected = store.frame(k), _frame(3 * k)
        np.testing.assert_array_equal(frame.color, expected.color)
        np.testing.assert_array_equal(frame.depth_raw, expected.depth_raw)
        assert (frame.index, frame.stamp_ns) == (expected.index, expected.stamp_ns)
        assert frame.camera == CAMERA and frame.depth_units_per_m == 5000.0
        np.testing.assert_array_equal(store.pose(k), _pose(k))


def test_keyframes_come_back_from_every_slab():
    count = 2 * SLAB_KEYFRAMES + 5
    arrays, store = _filled(count)
    _check(store, count)
    assert arrays.exists("keyframe_color.002") and not arrays.exists("keyframe_color.003")


class _OpenedTogether(MemoryAllocator):
    """Arrays that two threads open at the same time."""

    def __init__(self, arrays: MemoryAllocator) -> None:
        self._arrays = arrays._arrays
        self.meeting = threading.Barrier(1)

    def open(self, name: str) -> np.ndarray:
        with contextlib.suppress(threading.BrokenBarrierError):
            self.meeting.wait(0.05)
        return super().open(name)


def test_threads_that_open_slabs_at_once_see_the_pixels_of_each_keyframe():
    count = 3 * SLAB_KEYFRAMES
    arrays = _OpenedTogether(_filled(count)[0])
    store = KeyframeStore(arrays)
    arrays.meeting = threading.Barrier(2)
    with ThreadPoolExecutor(2) as pool:
        frames = list(pool.map(store.frame, range(count)))
    for k, frame in enumerate(frames):
        np.testing.assert_array_equal(frame.color, _frame(3 * k).color)
        assert frame.index == 3 * k


def test_a_second_attachment_sees_and_continues_the_first():
    count = SLAB_KEYFRAMES + 2
    arrays, store = _filled(count)
    reader = KeyframeStore(arrays)
    _check(reader, count)
    successor = KeyframeStore.create(arrays, CAMERA, 5000.0, 256)
    assert successor.append(_frame(3 * count), _pose(count)) == count
    _check(reader, count + 1)
    _check(store, count + 1)


def test_nothing_to_attach_to():
    with pytest.raises(KeyError):
        KeyframeStore(MemoryAllocator())


def test_correction_moves_only_its_keyframes():
    _, store = _filled(10)
    moved = np.stack([_pose(100), _pose(101)])
    assert store.pose_version == 0
    assert store.correct_poses(np.array([2, 7]), moved).version == 1
    expected = np.stack([_pose(k) for k in range(10)])
    expected[[2, 7]] = moved
    np.testing.assert_array_equal(store.poses(), expected)
    store.append(_frame(30), _pose(10))  # after a correction, and again after another
    store.correct_poses(np.array([0]), _pose(102)[None])
    expected = np.concatenate([expected, _pose(10)[None]])
    expected[0] = _pose(102)
    np.testing.assert_array_equal(store.poses(), expected)
    np.testing.assert_array_equal(store.pose(10), _pose(10))
    assert store.pose_version == 2


def test_a_correction_is_added_to_what_others_have_moved_since_it_was_computed():
    _, store = _filled(10)
    then, corrected = store.poses_of(np.array([2, 7])), np.stack([_pose(100), _pose(101)])
    store.correct_poses(np.array([7]), _pose(50)[None])
    moved = store.correct_poses(np.array([2, 7]), corrected, T_then=then)
    np.testing.assert_array_equal(store.pose(2), corrected[0])  # as it is: to the bit
    both = _pose(50) @ inverse(then[1]) @ corrected[1]
    np.testing.assert_allclose(store.pose(7), both, atol=1e-12)
    np.testing.assert_array_equal(moved.T_world_cam, store.poses_of(np.array([2, 7])))


def test_a_full_store_names_its_option():
    _, store = _filled(3, capacity=3)
    with pytest.raises(UserError, match=r"keyframes\.capacity = 3"):
        store.append(_frame(9), np.eye(4))
    assert store.count == 3


def test_another_depth_scale_is_refused():
    _, store = _filled(1)
    with pytest.raises(UserError, match=r"depth_units_per_m 1000\.0: expected 5000\.0"):
        store.append(replace(_frame(3), depth_units_per_m=1000.0), np.eye(4))


def test_a_depth_scale_that_a_driver_tells_with_seven_digits_is_the_same():
    _, store = _filled(1)
    told = 1.0 / float(np.float32(1 / 5000.0))
    assert told != 5000.0
    assert store.append(replace(_frame(3), depth_units_per_m=told), np.eye(4)) == 1


def test_another_camera_is_refused():
    _, store = _filled(1)
    camera = Camera(4, 6, 7.0, 7.5, 3.5, 2.5)
    frame = _frame(3)
    other = replace(
        frame, camera=camera, color=frame.color[:, :4], depth_raw=frame.depth_raw[:, :4]
    )
    with pytest.raises(UserError, match="4 x 6"):
        store.append(other, np.eye(4))
    assert store.count == 1


def test_readers_never_see_a_mixture_of_poses():
    """Writer: corrections that give all keyframes one number. Appender and readers go on meanwhile."""
    _, store = _filled(50, capacity=100_000)
    store.correct_poses(np.arange(50), np.zeros((50, 4, 4)))
    stop = threading.Event()
    mixed: list[np.ndarray] = []
    reads = 0

    def correct() -> None:
        value = 0.0
        while not stop.is_set():
            value += 1.0
            store.correct_poses(np.arange(50), np.full((50, 4, 4), value))

    def read() -> None:
        nonlocal reads
        while not stop.is_set():
            poses = store.poses()[:50]
            one = store.pose(49)
            reads += 1
            if (poses != poses[0, 0, 0]).any() or (one != one[0, 0]).any():
                mixed.append(poses)

    threads = [threading.Thread(target=correct), threading.Thread(target=read)]
    for thread in threads:
        thread.start()
    for k in range(50, 250):
        store.append(_frame(k), np.full((4, 4), -1.0))
    stop.wait(0.5)
    stop.set()
    for thread in threads:
        thread.join()
    assert not mixed and reads > 20
    np.testing.assert_array_equal(store.poses()[50:], np.full((200, 4, 4), -1.0))


def test_a_store_that_is_being_made_is_not_there_yet():
    arrays = MemoryAllocator()
    KeyframeStore.create(arrays, CAMERA, 5000.0, 16)
    arrays.open("keyframe_camera")[0] = 0  # as between making the array and filling it
    with pytest.raises(KeyError):
        KeyframeStore(arrays)


def test_losses_are_unknown_until_they_are_noted_and_shared_by_all():
    arrays, store = _filled(12)
    other = KeyframeStore(arrays)
    assert np.isnan(other.losses(np.arange(12))).all()
    store.note_losses(np.array([11, 3, 5]), np.array([0.5, 0.25, 0.0]))
    losses = other.losses(np.array([3, 4, 5, 11]))
    assert losses[[0, 3]].tolist() == [0.25, 0.5] and np.isnan(losses[1])
    assert losses[2] < 1e-300  # known: nothing is wrong there
    other.note_losses(np.array([3]), np.array([0.125]))
    assert store.losses(np.array([3])).tolist() == [0.125]
    store.append(_frame(36), _pose(12))
    assert np.isnan(store.losses(np.array([12])))
    _check(store, 13)


@pytest.mark.parametrize(
    ("width_px", "height_px", "keyframes"),
    [(160, 120, 8), (640, 480, 8), (1280, 720, 2), (1920, 1080, 1), (3840, 2160, 1)],
)
def test_a_slab_of_large_images_has_few_keyframes(width_px, height_px, keyframes):
    arrays, camera = MemoryAllocator(), Camera(width_px, height_px, 600.0, 600.0, 320.0, 240.0)
    store = KeyframeStore.create(arrays, camera, 5000.0, 16)
    assert store.has_room()
    assert arrays.open("keyframe_color.000").shape == (keyframes, height_px, width_px, 3)
    assert arrays.open("keyframe_depth.000").shape == (keyframes, height_px, width_px)


def test_rows_without_gaps_take_no_memory_for_them():
    arrays = MemoryAllocator()
    store = KeyframeStore.create(arrays, CAMERA, 5000.0, 16)
    store.append(_frame(0), np.eye(4))
    assert not store.gap_covariance(0).any() and not arrays.exists("keyframe_gaps.000")
    store.append(_frame(1), np.eye(4), gap_covariance=np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]))
    assert arrays.exists("keyframe_gaps.000") and not store.gap_covariance(0).any()
    assert store.gap_covariance(1).diagonal().tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]


class _NoRoomForGaps(MemoryAllocator):
    def create(self, name, shape, dtype):
        if name.startswith("keyframe_gaps"):
            raise OutOfMemoryError(f"array {name}: full")
        return super().create(name, shape, dtype)


def test_room_for_a_keyframe_is_room_for_its_gap():
    store = KeyframeStore.create(_NoRoomForGaps(), CAMERA, 5000.0, 16)
    assert store.has_room() and not store.has_room(has_gap=True)
    assert store.append(_frame(0), np.eye(4)) == 0
