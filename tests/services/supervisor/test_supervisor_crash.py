"""A crash of the supervisor: the watchdog takes over, and a service manager restarts the service."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

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
