"""Processes of a run that are not kept running: map loader, saver, evaluator, the watchdog."""

import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from hsslam_services.launch.process_table import ONE_SHOT_TIMEOUT_S, WATCHDOG
from hsslam_services.launch.spawn import Spawn, last_error, module_command, process_name, spawn
from hsslam_services.run.process_result import clear_result, read_result
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.summary import update_summary

_WATCHDOG_TIMEOUT_S = 5.0


def run_one_shot(
    module: str,
    run_dir: Path,
    tick: Callable[[], None],
    is_cancelled: Callable[[], bool],
    spawn: Spawn = spawn,
) -> str:
    """Run a process to its end, calling `tick` meanwhile; adds its section to the summary.

    Returns "" or what went wrong.
    """
    if is_cancelled():
        return "cancelled"
    timeout_s = ONE_SHOT_TIMEOUT_S[module]
    name = process_name(module)
    clear_result(run_dir, name)
    process = spawn(module, run_dir)
    deadline = time.monotonic() + timeout_s
    while (code := process.poll()) is None:
        tick()
        if is_cancelled() or time.monotonic() > deadline:
            process.kill()
            process.wait()
            return "cancelled" if is_cancelled() else f"not done after {timeout_s:g} s: killed"
    update_summary(run_dir, read_result(run_dir, name).summary)
    return last_error(run_dir, module) if code else ""


def start_watchdog(run: RunInfo) -> subprocess.Popen:
    """Start the process that cleans up behind a supervisor that was killed."""
    return subprocess.Popen(
        [*module_command(WATCHDOG, run.run_dir), "--arena", run.arena_dir],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


def expect_end(watchdog: subprocess.Popen) -> None:
    """Wait for the watchdog, which ends when the arena is removed."""
    try:
        watchdog.wait(_WATCHDOG_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        watchdog.kill()
        watchdog.wait()
