"""Processes of a run die: it goes on, ends with code 0, and says so."""

import contextlib
import resource
import time

import psutil
import pytest

from hsslam_node.geometry.trajectory import read_tum
from tests.services.ordinary_user import as_ordinary_user
from tests.services.serve_process import SMALL_ROOM

pytestmark = pytest.mark.e2e

GIVEN_UP = "tracker was killed by SIGKILL: too many restarts, given up"


def test_death_of_ba_recorder_mesher_fork_server_and_watchdog_costs_no_pose(serve):
    """Nor does a recorder that raises, and the log has all poses."""
    run = serve(*SMALL_ROOM, "--frames", "150", "--log-part-mb", "1")
    run.wait_for_poses(20)
    recorder = run.pid_of("recorder")
    few_files = (3, 3)  # so the next part cannot be opened
    resource.prlimit(recorder, resource.RLIMIT_NOFILE, few_files)
    run.wait_until(lambda: run.pid_of("recorder") not in (None, recorder), 15)
    for name in ("global_ba", "recorder", "mesher", "fork_server", "watchdog"):
        run.kill_worker(name)
    assert run.finish() == 0, run.stderr
    run.expect_nothing_left()
    assert "Too many open files" in run.stderr
    assert "fork server was killed by SIGKILL: restarted" in run.stderr
    assert "watchdog was killed by SIGKILL: restart in 0.5 s" in run.stderr
    summary = run.summary()
    for name, restarts in (("global_ba", 1), ("recorder", 2), ("mesher", 1)):
        assert summary["processes"][name]["restarts"] == restarts
        assert f"{name} was restarted {restarts} x" in run.stderr
    frames, log = summary["frames"], summary["log"]
    assert frames["in"] == 150
    assert frames["lost"] == 0
    assert frames["dropped"] <= 30
    assert log["complete"] and log["poses_logged"] == frames["tracked"]
    assert len(read_tum(run.out / "trajectory.txt")) == frames["tracked"]


def test_mapper_camera_and_tracker_are_replaced_and_a_crash_loop_ends_the_run_with_code_3(serve):
    run = serve(*SMALL_ROOM, "--synth.length", "1500", prefix=as_ordinary_user())
    run.wait_for_poses(20)
    for name in ("mapper", "camera", "tracker"):
        killed_ns = time.time_ns()
        run.kill_worker(name)
        while not any(p.stamp_ns > killed_ns and p.status == "tracked" for p in run.poses):
            run.wait_for_poses(1)
    killed: set[int] = set()
    deadline = time.monotonic() + 60
    # one that dies while it is born is no failed tracker: so not by the number killed
    while run.process.poll() is None and time.monotonic() < deadline and GIVEN_UP not in run.stderr:
        with contextlib.suppress(psutil.Error, AssertionError):
            pid = run.pid_of("tracker")
            if pid is not None and pid not in killed:
                psutil.Process(pid).kill()
                killed.add(pid)
        time.sleep(0.05)
    assert run.finish() == 3, run.stderr
    run.expect_nothing_left()
    assert GIVEN_UP in run.stderr
    summary = run.summary()
    for name, restarts in (("mapper", 1), ("camera", 1), ("tracker", 5)):
        assert summary["processes"][name]["restarts"] == restarts
        assert f"{name} was restarted {restarts} x" in run.stderr
    assert (run.out / "trajectory.txt").exists()
    assert (run.out / "mesh.ply").exists()
