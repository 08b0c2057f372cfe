"""The pose log: complete rows across slabs and attachments; final poses follow their keyframes."""

import tracemalloc

import numpy as np

from hsslam_node.geometry.se3 import inverse, se3_exp
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.epoch_poses import final_trajectory, fragment_trajectory, online_trajectory
from hsslam_node.map.pose_log import DEAD_RECKONED, LOST, SLAB_ROWS, TRACKED, PoseLog, pose_row
from hsslam_node.smooth_path import SmoothPath


def _row(index: int, T: np.ndarray, keyframe: int = -1, reference: np.ndarray | None = None):
    return pose_row(
        index=index,
        source_stamp_ns=10 * index,
        stamp_ns=index,
        publish_ns=index + 1,
        status=LOST if index % 5 == 3 else TRACKED,
        keyframe=keyframe,
        T_world_cam=T,
        T_keyframe_cam=np.eye(4) if reference is None else inverse(reference) @ T,
        quality=0.5,
        map_version=1,
    )


def test_rows_survive_a_second_attachment_and_cross_slabs():
    arrays = MemoryAllocator()
    log = PoseLog(arrays)
    assert log.last() is None
    assert len(log.rows()) == 0
    for index in range(SLAB_ROWS + 3):
        log.append(_row(index, np.eye(4)))
    again = PoseLog(arrays)
    assert again.count == SLAB_ROWS + 3
    assert again.rows()["index"].tolist() == list(range(SLAB_ROWS + 3))
    last = again.last()
    assert last is not None
    assert last["index"] == SLAB_ROWS + 2


def test_a_frame_is_found_by_camera_and_index():
    log = PoseLog(MemoryAllocator())
    for index in range(SLAB_ROWS + 3):
        row = _row(index, np.eye(4))
        row["publisher"] = 7
        log.append(row)
    row["publisher"], row["index"], row["pose_version"] = 9, 0, 4
    log.append(row)
    for publisher, index in ((7, 0), (7, SLAB_ROWS + 1), (9, 0)):
        found = log.find(publisher, index)
        assert found is not None
        assert (found["publisher"], found["index"]) == (publisher, index)
    assert log.find(9, 1) is None
    newest = [(int(row["publisher"]), int(row["index"])) for row in log.newest_of_each()]
    assert newest == [(7, SLAB_ROWS + 2), (9, 0)]


def test_newest_rows_are_known_after_any_death_of_the_writer():
    """Each row is appended by a writer that dies after it; frames of two fragments are among them."""
    arrays, row = MemoryAllocator(), _row(0, np.eye(4))
    for publisher, index, fragment in ((1, 0, 0), (2, 0, 3), (1, 1, 0), (3, 0, 4), (2, 1, 0)):
        row["publisher"], row["index"], row["fragment"] = publisher, index, fragment
        PoseLog(arrays).append(row)
    log = PoseLog(arrays)
    newest = [(int(row["publisher"]), int(row["index"])) for row in log.newest_of_each()]
    assert newest == [(1, 1), (3, 0), (2, 1)]
    assert log.newest_fragment() == 4
    for publisher in range(10, 80):
        row["publisher"] = publisher
        log.append(row)
    publishers = [int(row["publisher"]) for row in PoseLog(arrays).newest_of_each()]
    assert publishers[-64:] == list(range(16, 80))


def test_a_restarted_tracker_copies_no_long_log():
    arrays, row = MemoryAllocator(), _row(0, np.eye(4))
    log = PoseLog(arrays)
    for index in range(3 * SLAB_ROWS):
        row["index"] = index
        log.append(row)
    tracemalloc.start()
    log = PoseLog(arrays)
    SmoothPath(log, longest_gap_s=0.5)
    newest, _ = log.newest_of_each(), log.newest_fragment()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < SLAB_ROWS * row.nbytes / 10
    assert [int(each["index"]) for each in newest] == [3 * SLAB_ROWS - 1]


def test_final_poses_move_with_their_keyframe_and_lost_frames_have_none():
    rng = np.random.default_rng(0)
    poses = [se3_exp(rng.normal(size=6)) for _ in range(10)]
    log = PoseLog(MemoryAllocator())
    for index, T in enumerate(poses):
        log.append(_row(index, T, keyframe=0, reference=poses[0]))
    rows = log.rows()
    online = online_trajectory(rows)
    assert online.stamps_ns.tolist() == [0, 10, 20, 40, 50, 60, 70, 90]
    np.testing.assert_array_equal(online.T_world_cam[1], poses[1])
    same = final_trajectory(rows, poses[0][None])
    np.testing.assert_allclose(same.T_world_cam, online.T_world_cam, atol=1e-12)
    moved = se3_exp(np.array([0.1, 0, 0, 0, 0.2, 0]))
    final = final_trajectory(rows, (moved @ poses[0])[None])
    np.testing.assert_allclose(final.T_world_cam, moved @ online.T_world_cam, atol=1e-12)


def test_frames_of_a_fragment_are_lost_until_it_joins_the_map():
    log = PoseLog(MemoryAllocator())
    aside = se3_exp(np.array([0.0, 0.5, 0.0, 0.0, 0.0, 0.3]))
    own = se3_exp(np.array([0.1, 0.0, 0.0, 0.0, 0.2, 0.0]))
    for index, fragment in enumerate([0, 1, 1, 2]):
        row = _row(index, np.eye(4), keyframe=min(fragment, 1))
        row["status"], row["fragment"], row["T_keyframe_cam"] = (
            LOST * (fragment > 0) or TRACKED,
            fragment,
            own,
        )
        row["is_reckoned"] = index == 2
        log.append(row)
    rows = log.rows()
    assert log.joined(rows) is rows
    log.prepare_join(1, np.array([5, 5]), np.stack([np.eye(4), aside]))
    assert log.joined(rows) is rows  # its keyframes are not in the map yet
    log.join(1)
    joined = log.joined(rows)
    assert joined["status"].tolist() == [TRACKED, TRACKED, DEAD_RECKONED, LOST]
    assert joined["keyframe"].tolist() == [0, 5, 5, 1]
    keyframes = np.tile(np.eye(4), (6, 1, 1))
    keyframes[5, :3, 3] = 1.0, 2.0, 3.0
    final = final_trajectory(joined, keyframes)
    assert np.allclose(final.T_world_cam[1:], keyframes[5] @ aside @ own)
    assert len(online_trajectory(rows)) == 1
    assert fragment_trajectory(rows, 2).stamps_ns.tolist() == [30]
    assert PoseLog.owns("pose_joins") and PoseLog.owns("pose_join.0001")
