"""The savers and the rescue: files out of an arena that a real pipeline has filled, or has not."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from hsslam_node.geometry.trajectory import read_tum
from hsslam_node.map.checkpoint import load_checkpoint
from hsslam_node.map.pose_log import PoseLog
from hsslam_node.presets import PRESETS
from hsslam_node.slam import Slam
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_proto import topics
from hsslam_services.arena.arena import Arena
from hsslam_services.arena.unsaved_marker import read_unsaved
from hsslam_services.artefacts.rescue import rescue
from hsslam_services.bus.bus import Bus
from hsslam_services.launch.fork_client import ForkClient
from hsslam_services.run.process_result import read_result
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.summary import read_summary
from tests.services.conftest import started_fork_server

_ROOM = SynthOptions(width_px=160, height_px=120)
_FRAMES = 12
_REALTIME = PRESETS["realtime"]
_SLAM = replace(
    _REALTIME,
    mapper=replace(_REALTIME.mapper, first_iterations=60),
    mesher=replace(_REALTIME.mesher, final_voxel_m=0.06),
)
_FILES = ("trajectory.txt", "trajectory_online.txt", "keyframes.txt", "map.safetensors", "mesh.ply")


@pytest.fixture
def run(make_run: Callable[..., RunInfo]) -> RunInfo:
    return make_run(synth=_ROOM, frames=_FRAMES, slam=_SLAM)


@pytest.fixture
def client(run: RunInfo) -> Iterator[ForkClient]:
    """It forks the savers, as several fresh interpreters would take longer."""
    with started_fork_server(run) as client:
        yield client


def _save(run: RunInfo, client: ForkClient, saver: str) -> int:
    """Run a saver as the supervisor does; returns its exit code."""
    return client.spawn(f"hsslam_services.processes.{saver}", run.path).wait(120)


def _log_of(run: RunInfo, saver: str) -> str:
    return (run.path / "logs" / f"{saver}.log").read_text()


def _save_all(run: RunInfo, client: ForkClient) -> dict[str, Any]:
    """The sections of the summary that the savers leave."""
    sections: dict[str, Any] = {}
    for saver in ("trajectory_saver", "final_map_saver", "mesh_saver"):
        assert _save(run, client, saver) == 0, _log_of(run, saver)
        sections |= read_result(run.path, saver).summary
    return sections


def _fill(arena: Arena) -> None:
    slam = Slam(_SLAM, seed=0, arrays=arena)
    for frame in open_source("synth:room", SourceOptions(synth=_ROOM, frames=_FRAMES)).frames():
        slam.process(frame)
    log = PoseLog(arena)  # the tracker's
    for row in slam.pose_log.rows():
        log.append(row)


def test_trajectories_map_and_mesh_are_written_and_nothing_to_save_is_no_error(
    run: RunInfo, client: ForkClient
):
    _expect_nothing(run, _save_all(run, client))
    _fill(Arena(Path(run.arena_dir)))
    bus = Bus(run.endpoint, run.robot, "test")
    meshes = bus.subscribe(topics.MESH, 2)
    summary = _save_all(run, client)

    assert len(read_tum(run.path / "trajectory.txt")) == _FRAMES
    assert len(read_tum(run.path / "trajectory_online.txt")) == _FRAMES
    keyframes = read_tum(run.path / "keyframes.txt")
    checkpoint = load_checkpoint(run.path / "map.safetensors")
    np.testing.assert_array_equal(checkpoint.keyframe_stamps_ns, keyframes.stamps_ns)
    mesh = trimesh.load_mesh(run.path / "mesh.ply")
    assert len(mesh.faces) > 500
    assert np.ptp(mesh.visual.vertex_colors[:, :3]) > 50
    message = meshes.wait(5)
    bus.close()
    assert message is not None
    assert message.final
    assert message.face_count == len(mesh.faces)
    assert summary["frames"] == {"tracked": _FRAMES, "lost": 0}
    assert summary["keyframes"] == len(keyframes)
    assert summary["mesh"]["faces"] == len(mesh.faces)
    assert sum(summary["model_bytes"].values()) > 10**6

    saved = {name: (run.path / name).read_bytes() for name in _FILES}
    for name in _FILES:
        (run.path / name).unlink()
    (run.path / "trajectory.txt").mkdir()  # what cannot be written costs nothing else
    assert _save(run, client, "trajectory_saver") == 2
    assert "trajectory.txt: Is a directory" in _log_of(run, "trajectory_saver")
    lines: list[str] = []
    not_saved = rescue(Path(run.arena_dir), run.path, lines.append)
    assert list(not_saved) == ["trajectories"] == list(_unsaved(run))
    assert "Is a directory" in not_saved["trajectories"]
    assert "map: saved" in lines and "mesh: saved" in lines
    (run.path / "trajectory.txt").rmdir()
    assert rescue(Path(run.arena_dir), run.path, lines.append) == {}
    assert _unsaved(run) == ()
    again = {name: (run.path / name).read_bytes() for name in _FILES}
    assert len(again.pop("map.safetensors")) == len(
        saved.pop("map.safetensors")
    )  # keys in any order
    assert again == saved
    assert read_summary(run.path)["frames"] == {"tracked": _FRAMES, "lost": 0}


def _expect_nothing(run: RunInfo, sections: dict[str, Any]) -> None:
    """Empty trajectories, and neither map nor mesh."""
    assert len(read_tum(run.path / "trajectory.txt")) == 0
    assert not (run.path / "mesh.ply").exists()
    assert sections["frames"] == {"tracked": 0, "lost": 0}


def _unsaved(run: RunInfo) -> tuple[str, ...]:
    found = read_unsaved(Path(run.arena_dir))
    assert found is not None
    return found.artefacts
