"""Trajectory files of a long run: the bytes of one text of all rows, written a slab at a time."""

import os
import tracemalloc

import numpy as np
import pytest

from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.trajectory import tum_text
from hsslam_node.map.epoch_poses import final_trajectory, fragment_trajectory, online_trajectory
from hsslam_node.map.pose_log import POSE_ROW, SLAB_ROWS
from hsslam_node.map.store import KeyframeStore
from hsslam_services.arena.arena import Arena
from hsslam_services.artefacts.trajectory_files import TrajectoryFiles
from hsslam_services.run.summary import pose_section
from tests.long_pose_log import COUNT, FIRST_OF_LAST_EPOCH, long_log


def test_files_and_statistics_are_those_of_all_rows(tmp_path):
    arena = Arena(tmp_path)
    store = KeyframeStore.create(arena, Camera(8, 6, 8.0, 8.0, 3.5, 2.5), 1000.0, 8)
    log = long_log(arena)
    tracemalloc.start()
    files = TrajectoryFiles(arena, store, map_epoch=1)
    section = files.section(tmp_path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    files.save(tmp_path)
    assert peak < 4 * SLAB_ROWS * POSE_ROW.itemsize

    rows = log.rows()
    here = rows[FIRST_OF_LAST_EPOCH:]
    expected = {
        "trajectory": final_trajectory(log.joined(here), store.poses()),
        "trajectory_online": online_trajectory(here),
        "trajectory_fragment_2": fragment_trajectory(here, 2),
    }
    written = {name: (tmp_path / f"{name}.txt").read_text() for name in expected}
    assert written == {name: tum_text(trajectory) for name, trajectory in expected.items()}
    assert not (tmp_path / "trajectory_fragment_1.txt").exists()

    of_all = pose_section([log.joined(rows)])
    assert {name: section[name] for name in of_all} == of_all
    frames = pose_section([log.joined(here)])["frames"]
    assert section["map_epochs"] == {
        "1": {**frames, "keyframes": 0, "trajectory": "trajectory.txt"}
    }
    assert section["fragments"] == {
        "1": {"frames": 10, "joined": True},
        "2": {"frames": 20, "joined": False, "trajectory": "trajectory_fragment_2.txt"},
    }
    (tmp_path / "map_fragment_2.safetensors").touch()
    assert files.section(tmp_path)["fragments"]["2"]["map"] == "map_fragment_2.safetensors"
    assert sum(frames[status] for status in ("tracked", "lost")) == COUNT - FIRST_OF_LAST_EPOCH
    assert np.isfinite(list(section["latency_ms"].values())).all()


def test_poses_that_the_disk_does_not_give_are_told_and_all_others_are_written(tmp_path):
    (tmp_path / "arena").mkdir()
    arena = Arena(tmp_path / "arena")
    store = KeyframeStore.create(arena, Camera(8, 6, 8.0, 8.0, 3.5, 2.5), 1000.0, 8)
    long_log(arena)
    TrajectoryFiles(arena, store, 1, ".whole").save(tmp_path)
    arena.move_to_disk("pose_log.001", tmp_path / "on disk")
    os.truncate(tmp_path / "on disk" / "pose_log.001.bin", 5000)
    files = TrajectoryFiles(arena, store, 1)
    section = files.section(tmp_path)
    files.save(tmp_path)
    assert "5000 bytes" in files.lost and f"{SLAB_ROWS} poses cannot be read" in files.lost
    whole, part = (
        (tmp_path / f"trajectory_online{suffix}.txt").read_text().splitlines()
        for suffix in (".whole", "")
    )
    assert set(part) < set(whole) and 0 < len(whole) - len(part) <= SLAB_ROWS
    assert section["sensor_s"] == pytest.approx((COUNT - 1) * 0.033)
