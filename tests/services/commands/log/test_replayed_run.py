"""A lockstep run from a lossless log gives the poses of the run that wrote it, also those by odometry alone;
the log of a killed run serves."""

import subprocess
import sys

import numpy as np
import psutil
import pytest

from hsslam_node.geometry.trajectory import read_tum
from hsslam_proto import messages
from hsslam_services.camera.open_source import open_any_source
from hsslam_services.log.reading.files import log_parts
from hsslam_services.log.reading.poses import logged_poses
from hsslam_services.log.reading.reader import bus_messages
from hsslam_services.run.summary import read_summary
from tests.services.serve_process import SENT_ROOM, SMALL_ROOM

pytestmark = pytest.mark.e2e

_SMALL = [option for option in SMALL_ROOM if option not in ("--source", "synth:room")]
_LATEST_LOSS = 25  # frames at 15 Hz: a second, and what was on its way


def test_a_replayed_lockstep_run_has_the_same_poses_bit_for_bit(serve):
    options = ("--pace", "lockstep", "--seed", "3", *_SMALL)
    room = ("--source", "synth:room", "--frames", "25", "--noise", "kinect")
    covered = ("--synth.odometry-noise", "0.01", "--cover-at", "9", "--cover-frames", "2")
    imu = ("--synth.imu-noise", "1")
    logged = serve(*options, *room, *covered, *imu, "--log-color", "png", "--log-part-mb", "1")
    assert logged.finish(timeout_s=280) == 0, logged.stderr
    frames = logged.summary()["frames"]
    assert (frames["tracked"], frames["lost"], frames["dead_reckoned"]) == (25, 0, 2)
    parts = read_summary(logged.out)["log"]["parts"]
    assert len(parts) > 1
    replayed = serve(*options, "--source", f"mcap:{logged.out}")
    assert replayed.finish(timeout_s=280) == 0, replayed.stderr
    assert replayed.summary()["frames"]["in"] == 25
    stepped = serve(*options[:4], *SENT_ROOM)
    assert stepped.bus.is_connected()
    replay = [
        sys.executable,
        "-m",
        "hsslam_services.commands.log.replay",
        str(logged.out),
        "--step",
    ]
    subprocess.run([*replay, "--connect", stepped.endpoint], check=True, timeout=280)
    assert stepped.finish(timeout_s=280) == 0, stepped.stderr
    for run in (replayed, stepped):
        for name in ("trajectory.txt", "trajectory_online.txt", "keyframes.txt"):
            assert (logged.out / name).read_bytes() == (run.out / name).read_bytes(), name
    found = logged_poses(log_parts(str(logged.out), print))
    of_run = read_tum(logged.out / "trajectory.txt")
    np.testing.assert_allclose(found.final.T_world_cam, of_run.T_world_cam, atol=1e-8)
    assert sum(pose.is_dead_reckoned for pose in found.poses) == 2


def test_the_log_of_a_run_killed_whole_is_recovered_and_replays(serve):
    run = serve("--source", "synth:room", *_SMALL, "--synth.length", "1500")
    run.wait_for_poses(40)
    heard = run.poses[-1].index
    processes = psutil.Process(run.process.pid).children(recursive=True)
    run.close()  # SIGKILL for all
    psutil.wait_procs(processes, timeout=10)
    told: list[str] = []
    files = log_parts(run.out, told.append)
    assert len(told) == 1 and "recovered" in told[0]
    poses = [logged.message() for logged in bus_messages(files, {"out/pose"})]
    assert isinstance(poses[-1], messages.Pose) and poses[-1].index >= heard - _LATEST_LOSS
    frames = list(open_any_source(f"mcap:{run.out}").frames())
    assert len(frames) >= len(poses) - _LATEST_LOSS
