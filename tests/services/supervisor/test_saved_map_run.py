"""A map is saved by one run; the next ones localise in it, go on in it, or are told why they cannot."""

import signal

import numpy as np
import pytest

from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.geometry.trajectory import read_tum
from hsslam_node.map.checkpoint import load_checkpoint
from hsslam_services.log.reading.files import log_parts
from hsslam_services.log.reading.poses import logged_poses
from tests.services.serve_process import SMALL_ROOM

pytestmark = pytest.mark.e2e

_MOUNT = (0.1, 0.0, 0.3, -0.5, 0.5, -0.5, 0.5)
_TILTED = (0.1, 0.0, 0.3, -0.612372, 0.612372, -0.353553, 0.353553)


def test_localise_only_finds_its_place_and_changes_no_byte(serve):
    """A run that goes on in the map leaves the same corrected poses in its files and in its log."""
    first = serve(
        *SMALL_ROOM, "--base-T-camera", *map(str, _MOUNT), "--frames", "16", "--pace", "lockstep"
    )
    assert first.finish() == 0, first.stderr
    saved = first.out / "map.safetensors"
    level = load_checkpoint(saved).T_level_world
    np.testing.assert_allclose(level, RobotFrames.mounted(_MOUNT).T_base_cam, atol=1e-12)
    before = saved.read_bytes()

    second = serve(
        *(*SMALL_ROOM, "--start", "8", "--frames", "12", "--pace", "lockstep"),
        *("--map", str(saved), "--localise-only", "--grid"),
        *("--base-T-camera", *map(str, _TILTED)),
    )
    known = len(read_tum(first.out / "keyframes.txt"))
    second.wait_until(lambda: (now := second.status()) and now.keyframes == known, 60)
    assert second.finish() == 0, second.stderr
    second.expect_nothing_left()
    assert saved.read_bytes() == before
    assert f"map_loader: localises in {saved}" in second.stderr
    assert "the map is as it was loaded: not saved again" in second.stderr
    assert "saving the map" not in second.stderr
    assert (
        "grid: direction up by --base-T-camera: 0.000 -1.000 0.000" in second.stderr
    )  # as in the map
    summary = second.summary()
    assert summary["frames"]["tracked"] == 12 and summary["frames"]["lost"] == 0
    assert summary["map"]["versions"] == summary["ba_rounds"] == 0
    assert not (second.out / "map.safetensors").exists()
    assert len(read_tum(second.out / "keyframes.txt")) == 0
    then, now = (read_tum(run.out / "trajectory.txt") for run in (first, second))
    shared = np.isin(now.stamps_ns, then.stamps_ns)
    apart_m = np.linalg.norm(now.positions[shared] - then.positions[8:], axis=1)
    assert len(apart_m) == 8 and apart_m.max() < 0.02

    continued = serve(
        *(*SMALL_ROOM, "--frames", "16", "--pace", "lockstep", "--map", str(saved)),
        *("--slam.mapper.pose-rate", "0.001", "--slam.mesher.final-voxel-m", "0.2"),
    )
    assert continued.finish() == 0, continued.stderr
    corrected = read_tum(continued.out / "trajectory.txt")
    online = read_tum(continued.out / "trajectory_online.txt")
    assert np.abs(corrected.positions - online.positions).max() > 1e-6
    new = len(read_tum(continued.out / "keyframes.txt"))
    in_map = len(load_checkpoint(continued.out / "map.safetensors").keyframe_stamps_ns)
    assert known + 1 <= in_map < known + new  # the map shows nearly all of this
    found = logged_poses(log_parts(str(continued.out), print))
    np.testing.assert_allclose(found.final.T_world_cam, corrected.T_world_cam, atol=1e-8)

    stopped = serve(*SMALL_ROOM, "--map", str(saved))
    stopped.wait_until((stopped.out / "run.json").exists, 20)  # the map is loaded next
    stopped.signal(signal.SIGINT)
    assert stopped.finish() == 0, stopped.stderr
    assert stopped.summary()["stop_reason"] == "interrupted"
    stopped.expect_nothing_left()

    saved.write_bytes(before[:100_000])
    third = serve(*SMALL_ROOM, "--map", str(saved))
    assert third.finish() == 2
    assert f"error: {saved}: damaged map: " in third.stderr
    third.expect_nothing_left()
