"""Trajectories of a map epoch in pieces have every bit of those of all rows at once."""

import tracemalloc
from collections.abc import Iterable

import numpy as np

from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.epoch_poses import (
    EpochPoses,
    final_trajectory,
    fragment_trajectory,
    online_trajectory,
)
from hsslam_node.map.pose_log import DEAD_RECKONED, LOST, POSE_ROW, SLAB_ROWS, PoseLog
from tests.long_pose_log import FIRST_OF_LAST_EPOCH, KEYFRAMES, long_log, long_rows


def _expect_same(pieces: Iterable[Trajectory], whole: Trajectory) -> None:
    found = list(pieces)
    np.testing.assert_array_equal(np.concatenate([p.stamps_ns for p in found]), whole.stamps_ns)
    np.testing.assert_array_equal(np.concatenate([p.T_world_cam for p in found]), whole.T_world_cam)


def test_pieces_are_the_trajectories_of_all_rows():
    log = long_log(MemoryAllocator())
    for epoch, of_it in enumerate(np.split(log.rows(), [FIRST_OF_LAST_EPOCH])):
        poses, joined = EpochPoses(log, epoch), log.joined(of_it)
        assert len(poses) == len(of_it)
        _expect_same(poses.online(), online_trajectory(of_it))
        _expect_same(poses.final(KEYFRAMES), final_trajectory(joined, KEYFRAMES))
    found = poses.fragments()
    assert {number: place.frames for number, place in found.items()} == {1: 10, 2: 20}
    _expect_same(poses.fragment(2, found[2]), fragment_trajectory(of_it, 2))
    assert len(EpochPoses(log, 2)) == 0 and EpochPoses(log, 2).fragments() == {}


def test_stretches_at_borders_of_slabs_are_fitted():
    """The rows of the test above are such that it matters where pieces end."""
    rows = long_rows()[FIRST_OF_LAST_EPOCH:]
    kept = rows[rows["status"] != LOST]
    final = final_trajectory(kept, np.zeros((0, 4, 4))).T_world_cam
    is_fitted = (final != kept["T_world_cam"]).any(axis=(1, 2))
    assert set(kept["status"][is_fitted]) == {DEAD_RECKONED}
    assert is_fitted[np.isin(kept["index"], [SLAB_ROWS - 1, SLAB_ROWS, 2 * SLAB_ROWS - 1])].all()
    assert not is_fitted[kept["index"] >= 3 * SLAB_ROWS - 2].any()


def test_an_epoch_without_rows_has_no_poses():
    poses = EpochPoses(PoseLog(MemoryAllocator()), 0)
    assert [len(piece) for piece in poses.final(KEYFRAMES)] == [0]
    assert not list(poses.online()) and poses.fragments() == {}


def test_pieces_need_the_memory_of_some_slabs():
    log = long_log(MemoryAllocator())
    tracemalloc.start()
    count = sum(len(piece) for piece in EpochPoses(log, 1).final(KEYFRAMES))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert count > 2.9 * SLAB_ROWS
    assert peak < 4 * SLAB_ROWS * POSE_ROW.itemsize
