import os
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import transform
from hsslam_node.geometry.se3_batch import quaternions_from_rotations
from hsslam_node.map.epoch_poses import final_trajectory
from hsslam_node.map.pose_log import LOST, SLAB_ROWS, TRACKED, PoseLog, pose_row
from hsslam_node.map.store import KeyframeStore
from hsslam_proto.codec import decode, encode, encoding_of
from hsslam_proto.request_messages import Ask, Refusal, TrajectoryRows
from hsslam_proto.requests import STATUS, TRAJECTORY, Request
from hsslam_services.arena.arena import Arena
from hsslam_services.arena.arena_folder import remove_arrays
from hsslam_services.arena.arena_view import ArenaView
from hsslam_services.bus.ask import NoServiceError, ask
from hsslam_services.bus.bus import Bus
from hsslam_services.health.run_state import RunState
from hsslam_services.requests.gateway import Gateway
from hsslam_services.requests.mesh_and_trajectory import (
    MOST_POSES,
    trajectory_of,
    trajectory_so_far,
)
from hsslam_services.run.run_info import RunInfo
from tests.long_pose_log import long_log, long_rows

_CAMERA = Camera(8, 6, 8.0, 8.0, 3.5, 2.5)
_T = transform(np.array([1.0, 2.0, 3.0]), np.array([0.5, -0.5, 0.5, 0.5]))


def test_there_is_none_before_the_first_pose(tmp_path):
    none = Refusal(reason="not_now", text="trajectory: there is no pose yet")
    assert trajectory_so_far(tmp_path) == none
    KeyframeStore.create(Arena(tmp_path), _CAMERA, 1000.0, 8)
    assert trajectory_so_far(tmp_path) == none


def test_poses_are_read_without_the_arena_and_cross_the_wire(tmp_path):
    arena = Arena(tmp_path)
    KeyframeStore.create(arena, _CAMERA, 1000.0, 8)
    log = PoseLog(arena)
    for k, status in enumerate((TRACKED, LOST, TRACKED)):
        log.append(_row(k, status))
    payload = encode(TRAJECTORY.answered, _expect_rows(trajectory_so_far(tmp_path)))
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
    told = [_expect_rows(trajectory_so_far(tmp_path, map_epoch)).count for map_epoch in (0, 1)]
    assert told == [2, 1]
    remove_arrays(tmp_path, PoseLog.owns)
    kept = ["pose_header", "pose_joins", "pose_log.000", "pose_newest"]
    assert sorted(file.stem for file in tmp_path.glob("*.bin")) == kept
    assert isinstance(trajectory_so_far(tmp_path, 1), Refusal)  # the new map has no keyframe yet
    KeyframeStore.create(arena, _CAMERA, 1000.0, 8)
    assert _expect_rows(trajectory_so_far(tmp_path, 1)).count == 1


def test_more_poses_than_an_answer_holds_are_refused_before_they_are_read(tmp_path):
    assert TRAJECTORY.answered.size_limit_bytes > 64 * MOST_POSES + 1024
    KeyframeStore.create(Arena(tmp_path), _CAMERA, 1000.0, 8)
    log = long_log(Arena(tmp_path))
    refusal = trajectory_so_far(tmp_path, 1, most=log.count - 101)
    assert isinstance(refusal, Refusal) and refusal.reason == "size"
    assert f"{log.count - 100} frames: expected at most {log.count - 101}" in refusal.text
    assert "trajectory.txt" in refusal.text
    rows = _expect_rows(trajectory_so_far(tmp_path, 1, most=log.count - 100))
    whole = final_trajectory(log.joined(log.rows()[100:]), np.zeros((0, 4, 4)))
    np.testing.assert_array_equal(np.frombuffer(rows.stamps_ns, "<i8"), whole.stamps_ns)
    poses = np.frombuffer(rows.poses, "<f8").reshape(-1, 7)
    np.testing.assert_array_equal(poses[:, :3], whole.positions)
    rotations = whole.T_world_cam[:, :3, :3]
    np.testing.assert_array_equal(poses[:, 3:], quaternions_from_rotations(rotations))


def test_without_the_poses_that_the_disk_does_not_give_the_others_are_told(tmp_path):
    (tmp_path / "arena").mkdir()
    arena, told = Arena(tmp_path / "arena"), []
    KeyframeStore.create(arena, _CAMERA, 1000.0, 8)
    long_log(arena)
    whole = _expect_rows(trajectory_so_far(arena.folder, 1, report=told.append))
    arena.move_to_disk("pose_log.001", tmp_path / "run")
    os.truncate(tmp_path / "run" / "pose_log.001.bin", 5000)
    part = _expect_rows(trajectory_so_far(arena.folder, 1, report=told.append))
    missing = np.setdiff1d(*(np.frombuffer(rows.stamps_ns, "<i8") for rows in (whole, part)))
    in_it = long_rows()["source_stamp_ns"][SLAB_ROWS : 2 * SLAB_ROWS]
    assert 900 < len(missing) <= SLAB_ROWS and np.isin(missing, in_it).all()
    [line] = told
    assert line.startswith(f"trajectory: {tmp_path / 'run' / 'pose_log.001.bin'}: 5000 bytes")


def test_other_requests_are_answered_while_poses_are_read(run_info: RunInfo):
    """A pipe in the place of an array's header is a disk that takes its time."""
    arena_dir, is_over = Path(run_info.arena_dir), threading.Event()
    KeyframeStore.create(Arena(arena_dir), _CAMERA, 1000.0, 8)
    PoseLog(Arena(arena_dir)).append(_row(0, TRACKED))
    header = arena_dir / "pose_log.000.json"
    content = header.read_text()
    header.unlink()
    os.mkfifo(header)
    with (
        Bus(run_info.endpoint, run_info.robot, "supervisor") as bus,
        ThreadPoolExecutor(2) as threads,
    ):
        gateway = Gateway(bus, run_info, _no_process)

        def turn() -> None:
            while not is_over.wait(0.005):
                gateway.tick(RunState(), {}, 0)

        try:
            threads.submit(turn)
            told = threads.submit(_ask, run_info, TRAJECTORY)
            with header.open("w") as pipe:  # it is being read now
                assert _ask(run_info, STATUS).run_id == run_info.run_id
                pipe.write(content)
            assert told.result(30).count == 1
        finally:
            is_over.set()
            gateway.close()


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


def _ask(run: RunInfo, request: Request):
    while True:
        try:
            return ask(run.endpoint, run.robot, request, Ask())
        except NoServiceError:  # the router knows the gateway a moment later
            continue


def _no_process(*_):
    raise AssertionError("no process is started")


def _expect_rows(answer: TrajectoryRows | Refusal) -> TrajectoryRows:
    assert isinstance(answer, TrajectoryRows)
    return answer


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
