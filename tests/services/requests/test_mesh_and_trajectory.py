import numpy as np
import pytest

from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import transform
from hsslam_node.map.pose_log import LOST, TRACKED, PoseLog, pose_row
from hsslam_node.map.store import KeyframeStore
from hsslam_proto.codec import decode, encode, encoding_of
from hsslam_proto.requests import TRAJECTORY
from hsslam_services.arena.arena import Arena
from hsslam_services.arena.arena_folder import remove_arrays
from hsslam_services.arena.arena_view import ArenaView
from hsslam_services.requests.mesh_and_trajectory import rows_of, trajectory_of, trajectory_so_far

_CAMERA = Camera(8, 6, 8.0, 8.0, 3.5, 2.5)
_T = transform(np.array([1.0, 2.0, 3.0]), np.array([0.5, -0.5, 0.5, 0.5]))


def test_there_is_none_before_the_first_pose(tmp_path):
    assert trajectory_so_far(tmp_path) is None
    KeyframeStore.create(Arena(tmp_path), _CAMERA, 1000.0, 8)
    assert trajectory_so_far(tmp_path) is None


def test_poses_are_read_without_the_arena_and_cross_the_wire(tmp_path):
    arena = Arena(tmp_path)
    KeyframeStore.create(arena, _CAMERA, 1000.0, 8)
    log = PoseLog(arena)
    for k, status in enumerate((TRACKED, LOST, TRACKED)):
        log.append(_row(k, status))
    found = trajectory_so_far(tmp_path)
    assert found is not None
    payload = encode(TRAJECTORY.answered, rows_of(found))
    rows = decode(TRAJECTORY.answered, payload, encoding_of(TRAJECTORY.answered))
    back = trajectory_of(rows)  # type: ignore[arg-type]
    assert list(back.stamps_ns) == [1_700_000_000_000_000_001, 1_700_000_000_000_000_003]
    np.testing.assert_allclose(back.T_world_cam, [_T, _T], atol=1e-12)


def test_poses_of_two_map_epochs_are_never_told_together(tmp_path):
    arena = Arena(tmp_path)
    KeyframeStore.create(arena, _CAMERA, 1000.0, 8)
    log = PoseLog(arena)
    for k, map_epoch in enumerate((0, 0, 1)):
        log.append(_row(k, TRACKED, map_epoch))
    told = {map_epoch: trajectory_so_far(tmp_path, map_epoch) for map_epoch in (0, 1)}
    assert [len(poses) for poses in told.values() if poses is not None] == [2, 1]
    remove_arrays(tmp_path, PoseLog.owns)
    kept = ["pose_header", "pose_joins", "pose_log.000"]
    assert sorted(file.stem for file in tmp_path.glob("*.bin")) == kept
    assert trajectory_so_far(tmp_path, 1) is None  # no keyframe of the new map epoch is there yet
    KeyframeStore.create(arena, _CAMERA, 1000.0, 8)
    again = trajectory_so_far(tmp_path, 1)
    assert again is not None and len(again) == 1


def test_a_view_changes_nothing(tmp_path):
    Arena(tmp_path).create("a", (3,), np.int64)
    view = ArenaView(tmp_path)
    assert view.exists("a") and not view.exists("b")
    with pytest.raises(ValueError, match="read-only"):
        view.open("a")[0] = 1
    with pytest.raises(ValueError, match="read-only"):
        view.remove("a")
    with pytest.raises(ValueError, match="array a is int64"):
        view.create("a", (4,), np.int64)
    with pytest.raises(KeyError, match="b"):
        view.create("b", (4,), np.int64)


def _row(index: int, status: int, map_epoch: int = 0) -> np.ndarray:
    return pose_row(
        index=index,
        source_stamp_ns=1_700_000_000_000_000_001 + index,
        stamp_ns=1,
        publish_ns=2,
        status=status,
        keyframe=-1,
        T_world_cam=_T,
        T_keyframe_cam=np.eye(4),
        quality=1.0,
        map_version=1,
        map_epoch=map_epoch,
    )
