"""Old retired keyframes settle: their poses stay right, although only those of anchors are corrected."""

import threading

import numpy as np
import numpy.typing as npt
import pytest

from hsslam_node.errors import OutOfMemoryError
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.keyframes.row_slabs import BLOCK_ROWS, SLAB_ROWS
from hsslam_node.map.store import KeyframeStore
from tests.long_store import STAYS, LongStore

_COUNT = 3 * SLAB_ROWS
_EXACT = 2 * SLAB_ROWS  # newest keyframes, and all of a shorter run: none of them settles


class Dropping(MemoryAllocator):
    """What is dropped is 0, as in shared memory, and may not be dropped twice."""

    def __init__(self) -> None:
        super().__init__()
        self.dropped: set[tuple[str, int]] = set()
        self.is_full = False

    def create(self, name: str, shape: tuple[int, ...], dtype: npt.DTypeLike) -> np.ndarray:
        if self.is_full and name.startswith("keyframe_settled"):
            raise OutOfMemoryError("full")
        return super().create(name, shape, dtype)

    def drop_row(self, name: str, row: int) -> None:
        if name.startswith("keyframe_poses"):
            assert (name, row) not in self.dropped
            self.dropped.add((name, row))
        self.open(name)[row] = 0


@pytest.fixture(scope="module")
def arrays() -> Dropping:
    return Dropping()


@pytest.fixture(scope="module")
def long(arrays: Dropping) -> LongStore:
    made = LongStore(arrays)
    made.extend(_COUNT)
    return made


@pytest.fixture(scope="module")
def exact() -> tuple[LongStore, Dropping]:
    """As long as a store can be in which none settles."""
    arrays = Dropping()
    made = LongStore(arrays)
    made.extend(_EXACT)
    return made, arrays


@pytest.fixture
def copied(exact: tuple[LongStore, Dropping]) -> tuple[LongStore, Dropping]:
    """A copy of the store `exact`."""
    arrays = Dropping()
    for name, array in exact[1]._arrays.items():
        arrays.create(name, array.shape, array.dtype)[:] = array
    made = LongStore(arrays)
    made.go_on_from(exact[0])
    return made, arrays


def test_poses_of_settled_keyframes_follow_their_anchors(long: LongStore, arrays: Dropping):
    assert len(arrays.dropped) > 2 * 0.5 * (_COUNT - _EXACT) / BLOCK_ROWS  # of both banks
    for store in (long.store, KeyframeStore(arrays)):  # in every process
        poses = store.poses()
        np.testing.assert_allclose(poses, long.T_world_cam, atol=1e-5)
        ids = np.arange(0, _COUNT, 7)[::-1]
        np.testing.assert_array_equal(store.poses_of(ids), poses[ids])
        for k in (1, 201, SLAB_ROWS + 5, _COUNT - 1):
            np.testing.assert_allclose(store.pose(k), poses[k], atol=1e-12)


def test_a_settled_keyframe_has_the_covariance_of_its_anchor(long: LongStore):
    assert long.store.covariance(_COUNT - 1)[0, 0] == _COUNT
    assert long.store.covariance(0)[0, 0] == 1
    assert [long.store.covariance(k)[0, 0] for k in (200, 203)] == [1, 1]
    assert long.roots()[[200, 203]].tolist() == [0, 0]


def test_a_correction_names_settled_keyframes_too(long: LongStore):
    kept = long.store.kept()
    moved = long.store.correct_poses(kept, long.store.poses_of(kept) + np.eye(4, k=3) * 0.5)
    assert moved.keyframes.tolist() == list(range(_COUNT))
    np.testing.assert_allclose(moved.T_world_cam, long.store.poses(), atol=1e-6)


def test_stamps_frames_and_anchors_of_settled_keyframes_stay(long: LongStore):
    assert long.store.stamps_ns().tolist() == long.store.frame_indices().tolist()
    assert long.store.stamps_ns().tolist() == list(range(_COUNT))


def test_anchors_of_settled_keyframes_may_settle_too(copied: tuple[LongStore, Dropping]):
    made, arrays = copied
    made.extend(_EXACT + 2048)
    for k in (0, STAYS):  # one after the other: a chain
        made.retire(k, k + STAYS)
        made.extend(made.store.count + 1024)
    for store in (made.store, KeyframeStore(arrays)):
        np.testing.assert_allclose(store.poses(), made.T_world_cam, atol=1e-5)
        np.testing.assert_array_equal(store.pose(200), store.poses()[200])


def test_a_reader_meanwhile_sees_every_pose(copied: tuple[LongStore, Dropping]):
    made, arrays = copied
    stop, wrong = threading.Event(), []

    def read() -> None:
        store = KeyframeStore(arrays)
        while not stop.is_set():
            poses = store.poses()
            wrong.extend(np.flatnonzero(poses[:, 3, 3] != 1.0).tolist())

    reader = threading.Thread(target=read)
    reader.start()
    made.extend(_EXACT + 2048)
    stop.set()
    reader.join()
    assert arrays.dropped and not wrong


def test_a_restarted_process_drops_what_the_one_before_left(copied: tuple[LongStore, Dropping]):
    made, arrays = copied
    made.extend(_EXACT + 2048)
    before = arrays.dropped.copy()
    assert before
    arrays.dropped.clear()
    made.store = KeyframeStore(arrays)
    made.extend(_EXACT + 2560)
    assert before <= arrays.dropped
    np.testing.assert_allclose(made.store.poses(), made.T_world_cam, atol=1e-5)


def test_a_block_that_a_process_marked_in_part_settles_as_a_whole(
    copied: tuple[LongStore, Dropping],
):
    made, arrays = copied
    made.extend(_EXACT + 2048)
    flags = arrays.open("keyframe_meta.000")[:, -1]
    settled = np.flatnonzero(flags[::BLOCK_ROWS])
    assert len(settled)
    last = int(settled[-1]) * BLOCK_ROWS
    flags[last + BLOCK_ROWS // 2 : last + BLOCK_ROWS] = 0  # the process died here
    arrays.dropped.clear()  # the next one drops again
    made.store = KeyframeStore(arrays)
    made.extend(_EXACT + 2560)
    assert flags[last : last + BLOCK_ROWS].all()
    np.testing.assert_allclose(made.store.poses(), made.T_world_cam, atol=1e-5)


def test_blocks_settle_once_there_is_memory_for_it(copied: tuple[LongStore, Dropping]):
    made, arrays = copied
    arrays.is_full = True
    made.extend(_EXACT + 2048)
    assert not arrays.dropped
    arrays.is_full = False
    made.extend(_EXACT + 2560)
    assert arrays.dropped
    np.testing.assert_allclose(made.store.poses(), made.T_world_cam, atol=1e-5)
