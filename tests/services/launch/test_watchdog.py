"""A killed supervisor: its processes end in order, its arena goes, within five seconds."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from hsslam_services.artefacts.lost_results import POSES_NOT_LOGGED
from hsslam_services.artefacts.replaced_results import ReplacedResults
from hsslam_services.run.process_result import ProcessResult, write_result

_SUPERVISOR = """
import os, sys, time
from pathlib import Path
from hsslam_services.arena.arena_folder import ArenaFolder
from hsslam_services.bus.bus import free_endpoint, open_router
from hsslam_services.launch.one_shot import start_watchdog
from hsslam_services.run.options import ServeOptions
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.stop_signals import END_SIGNAL
from hsslam_services.launch.spawn import spawn
run_dir = Path(sys.argv[1])
endpoint = free_endpoint()
router = open_router(endpoint)
arena = ArenaFolder("test", run_dir, root=run_dir)
info = RunInfo("test", str(run_dir), str(arena.path), endpoint, "robot", os.getpid(), 0,
               ServeOptions())
info.write()
info.write_into_arena()
(arena.path / "pose_header.bin").write_bytes(int(sys.argv[3]).to_bytes(8, sys.byteorder))
watchdog = start_watchdog(run_dir, arena.path)
child = spawn("tests.services.sample_worker", run_dir)
print(watchdog.pid, child.pid, flush=True)
time.sleep(float(sys.argv[2]))
arena.remove()
child.send_signal(END_SIGNAL)
child.wait()
"""


def _start(
    run_dir: Path, behaviour: str, seconds: float, poses: int = 0
) -> tuple[subprocess.Popen, list[int]]:
    (run_dir / "behaviour").write_text(behaviour)
    command = [sys.executable, "-c", _SUPERVISOR, str(run_dir), str(seconds), str(poses)]
    supervisor = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert supervisor.stdout is not None
    pids = [int(word) for word in supervisor.stdout.readline().split()]
    assert len(pids) == 2  # of the watchdog and of a process
    return supervisor, pids


def _wait_for_work(run_dir: Path) -> None:
    deadline = time.monotonic() + 20
    while not (run_dir / "at_work").exists():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def _wait_for_ends(pids: list[int], timeout_s: float) -> None:
    deadline = time.monotonic() + timeout_s
    while any(_lives(pid) for pid in pids):
        assert time.monotonic() < deadline
        time.sleep(0.02)


def _lives(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


@pytest.mark.parametrize(("behaviour", "is_ready"), [("obedient", 1), ("deaf", 1), ("obedient", 0)])
def test_killed_supervisor_leaves_nothing(tmp_path: Path, behaviour: str, is_ready: int):
    supervisor, pids = _start(tmp_path, behaviour, 60)
    if is_ready:
        _wait_for_work(tmp_path)
    supervisor.send_signal(signal.SIGKILL)
    supervisor.wait()
    _wait_for_ends(pids, 30.0)
    assert not (tmp_path / "hsslam-test").exists()
    assert (tmp_path / "ended").exists() == (behaviour == "obedient" and is_ready == 1)


@pytest.mark.parametrize("poses", [0, 1])
def test_results_of_the_run_before_come_back_if_a_run_is_killed_at_its_start(
    tmp_path: Path, poses: int
):
    (tmp_path / "map.safetensors").write_text("of the run before")
    ReplacedResults(tmp_path).set_aside()
    assert not (tmp_path / "map.safetensors").exists()
    supervisor, pids = _start(tmp_path, "obedient", 60, poses)
    _wait_for_work(tmp_path)
    supervisor.send_signal(signal.SIGKILL)
    supervisor.wait()
    _wait_for_ends(pids, 30.0)
    assert (tmp_path / "map.safetensors").read_text() == "of the run before"
    assert not ReplacedResults(tmp_path).exists


def test_orderly_end_needs_no_watchdog(tmp_path: Path):
    supervisor, pids = _start(tmp_path, "obedient", 1.5, poses=2)
    assert supervisor.wait(10) == 0
    _wait_for_ends(pids, 30.0)
    assert not (tmp_path / "summary.json").exists()  # it saved nothing


def test_what_the_run_had_lost_before_is_not_called_saved(tmp_path: Path):
    """A fragment that its tracker could not save, and a log whose recorder did not finish it."""
    logs = tmp_path / "logs"
    logs.mkdir()
    begun = {"1": {"joined": False}, "2": {"joined": True}}
    write_result(tmp_path, "trajectory_saver", ProcessResult(summary={"fragments": begun}))
    write_result(tmp_path, "tracker", ProcessResult(summary={POSES_NOT_LOGGED: 3}))
    (tmp_path / "run.mcap").write_bytes(b"begun")
    supervisor, pids = _start(tmp_path, "obedient", 60, poses=2)
    _wait_for_work(tmp_path)
    supervisor.send_signal(signal.SIGKILL)
    supervisor.wait()
    _wait_for_ends(pids, 60.0)
    told = json.loads((tmp_path / "summary.json").read_text())["not_saved"]
    assert told["poses"].startswith("3 are missing")
    assert told["fragments"] == "fragment 1: its tracker ended before: lost"
    assert told["log"].startswith("not finished; run hsslam-log recover")
