"""A crash of the supervisor: the watchdog takes over, and a service manager restarts the service."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from hsslam_services.log.file_index import is_finished
from hsslam_services.run.exit_code import ExitCode
from tests.services.serve_process import SMALL_ROOM
from tests.until import until

pytestmark = pytest.mark.e2e
# Runs one after the other, each of which crashes by one of these errors
_CRASHES = """
import errno, sys
from hsslam_services.commands.cli import exit_code
from hsslam_services.commands.serve_command_line import parse_command_line
from hsslam_services.supervisor.run_loop import RunLoop
from hsslam_services.supervisor.supervisor import Supervisor

def crash(loop):
    raise error

RunLoop.to_the_end = crash
for number, error in enumerate((
    MemoryError(), OSError(errno.ENOSPC, "No space left on device"), RuntimeError("of this program")
)):
    options = parse_command_line([*sys.argv[2:], "--out", f"{sys.argv[1]}/run{number}"])
    print(exit_code(Supervisor(options).run))
"""


_CRASH_LATER = """
import sys
from hsslam_services.commands.cli import exit_code
from hsslam_services.commands.serve_command_line import parse_command_line
from hsslam_services.supervisor.run_loop import RunLoop
from hsslam_services.supervisor.supervisor import Supervisor

start = RunLoop._start_late_processes

def crash(loop):
    start(loop)
    if loop._listener.state.tracked > 30:
        raise RuntimeError("of this program")

RunLoop._start_late_processes = crash
sys.exit(exit_code(Supervisor(parse_command_line(sys.argv[1:])).run))
"""


def test_after_a_crash_in_the_middle_recorder_and_tracker_end_in_order(tmp_path: Path):
    """As after a kill of the supervisor: the log is whole."""
    out = tmp_path / "run"
    command = [sys.executable, "-c", _CRASH_LATER, *SMALL_ROOM, "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == ExitCode.NOT_SAVED, done.stderr
    arena = Path(json.loads((out / "run.json").read_text())["arena_dir"])
    until(lambda: not arena.exists(), 60)
    assert is_finished(out / "run.mcap")
    assert json.loads((out / "summary.json").read_text())["not_saved"] == {}


def test_after_a_crash_of_the_supervisor_the_watchdog_takes_over_and_a_restart_is_asked_for(
    tmp_path: Path,
):
    command = [sys.executable, "-c", _CRASHES, str(tmp_path), *SMALL_ROOM]
    without_kernels = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}  # so without a fork server
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, env=without_kernels)
    assert done.stdout.split() == [str(int(ExitCode.NOT_SAVED))] * 3, done.stderr
    told = "error: the supervisor crashed (RuntimeError: of this program): its watchdog saves the"
    assert done.stderr.endswith(f"{told} results to {tmp_path}/run2\n")
    assert done.stderr.count("Traceback") == 3
    for number in range(3):
        run = json.loads((tmp_path / f"run{number}" / "run.json").read_text())
        until(lambda arena=Path(run["arena_dir"]): not arena.exists(), 30)
