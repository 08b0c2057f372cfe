"""Trajectory files of a long run: the bytes of one text of all rows, written a slab at a time."""

import tracemalloc

import numpy as np

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
