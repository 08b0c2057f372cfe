"""Runs the processes that end by themselves: map loader, savers, evaluator, watchdog."""

import contextlib
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from hsslam_node.errors import UserError
from hsslam_services.launch.process_table import WATCHDOG
from hsslam_services.launch.spawn import (
    NOT_STARTED,
    Process,
    Spawn,
    child_environment,
    last_error,
    module_command,
    not_started,
    open_log,
    process_name,
    spawn,
)
from hsslam_services.run.process_result import clear_result, read_result
from hsslam_services.run.summary import update_summary

_WATCHDOG_TIMEOUT_S = 5.0
_KILL_TIMEOUT_S = 5.0


def run_one_shot(
    module: str,
    run_dir: Path,
    tick: Callable[[], None],
    is_cancelled: Callable[[], bool],
    timeout_s: float,
    spawn: Spawn = spawn,
) -> str:
    """Run a process to its end, calling `tick` meanwhile; adds its section to the summary.

    Returns "" or the error.
    """
    if is_cancelled():
        return "cancelled"
    name = process_name(module)
    try:
        clear_result(run_dir, name)
        process = spawn(module, run_dir)
    except (OSError, MemoryError) as error:
        return not_started(error)
    deadline = time.monotonic() + timeout_s
    while (code := process.poll()) is None:
        tick()
        if is_cancelled() or time.monotonic() > deadline:
            _kill(process)
            return "cancelled" if is_cancelled() else f"not done after {timeout_s:.0f} s: killed"
    if code == NOT_STARTED:
        return "cannot be started"
    error = last_error(run_dir, module) if code else ""
    with contextlib.suppress(OSError):  # the end of the run reports this
        update_summary(run_dir, read_result(run_dir, name).summary)
    return error


def _kill(process: Process) -> None:
    """Kill the process and wait at most 5 s: it may hang in a driver."""
    process.kill()
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(_KILL_TIMEOUT_S)


def start_watchdog(run_dir: Path, arena_dir: Path) -> subprocess.Popen:
    """Start the watchdog, which saves and cleans up after a killed supervisor.

    Raises:
        UserError: the watchdog cannot be started, or its log cannot be written.
    """
    try:
        with open_log(run_dir, WATCHDOG) as log:
            return subprocess.Popen(
                [*module_command(WATCHDOG, str(run_dir)), "--arena", str(arena_dir)],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=child_environment(),
                start_new_session=True,
            )
    except OSError as error:
        raise UserError(f"{run_dir}: the watchdog {not_started(error)}") from None


def expect_end(watchdog: subprocess.Popen) -> None:
    """Wait for the watchdog, which ends when the arena is removed or marked as unsaved; else kill it."""
    try:
        watchdog.wait(_WATCHDOG_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        _kill(watchdog)
