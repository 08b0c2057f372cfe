"""A crash of the supervisor: the watchdog saves the results, and a service manager restarts the service."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from hsslam_node.geometry.trajectory import read_tum
from hsslam_services.run.exit_code import ExitCode
from tests.services.serve_process import SMALL_ROOM
from tests.until import until

pytestmark = pytest.mark.e2e
# Three runs, each of which crashes by one of these errors; the last has a pose
_CRASHES = """
import errno, sys
import numpy as np
from hsslam_node.map.pose_log import TRACKED, PoseLog, pose_row
from hsslam_services.arena.arena import Arena
from hsslam_services.commands.cli import exit_code
from hsslam_services.commands.serve_command_line import parse_command_line
from hsslam_services.supervisor.run_loop import RunLoop
from hsslam_services.supervisor.supervisor import Supervisor

def crash(loop):
    if not isinstance(error, RuntimeError):
        raise error
    PoseLog(Arena(loop._info.arena_dir)).append(pose_row(
        index=0, source_stamp_ns=1, stamp_ns=1, publish_ns=2, status=TRACKED, keyframe=-1,
        T_world_cam=np.eye(4), T_keyframe_cam=np.eye(4), quality=1.0, map_version=0,
    ))
    raise error

RunLoop.to_the_end = crash
for number, error in enumerate((
    MemoryError(), OSError(errno.ENOSPC, "No space left on device"), RuntimeError("of this program")
)):
    options = parse_command_line([*sys.argv[2:], "--out", f"{sys.argv[1]}/run{number}"])
    print(exit_code(Supervisor(options).run))
"""


def test_a_crash_of_the_supervisor_costs_no_result_and_asks_for_a_restart(tmp_path: Path):
    command = [sys.executable, "-c", _CRASHES, str(tmp_path), *SMALL_ROOM]
    without_kernels = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}  # so without a fork server
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, env=without_kernels)
    assert done.stdout.split() == [str(int(ExitCode.NOT_SAVED))] * 3, done.stderr
    told = "error: the supervisor crashed (RuntimeError: of this program): its watchdog saves the"
    last = tmp_path / "run2"
    assert f"{told} results to {last}\n" in done.stderr
    assert done.stderr.count("Traceback") == 3
    arena = Path(json.loads((last / "run.json").read_text())["arena_dir"])
    until(lambda: not arena.exists(), 60)
    assert len(read_tum(last / "trajectory.txt")) == 1
