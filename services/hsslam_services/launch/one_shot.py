"""Runs the processes that end by themselves: map loader, savers, evaluator, watchdog."""

import contextlib
import errno
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from hsslam_node.errors import UserError
from hsslam_services.disk.disk_work import STEP_S, DiskWork
from hsslam_services.launch.process_table import WATCHDOG
from hsslam_services.launch.spawn import (
    NOT_STARTED,
    Process,
    Spawn,
    child_environment,
    how_it_ended,
    last_error,
    module_command,
    not_started,
    open_log,
    process_name,
    spawn,
)
from hsslam_services.run.process_result import ProcessResult, clear_result, read_result
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
    disk: DiskWork | None = None,
) -> str:
    """Run a process to its end, calling `tick` meanwhile; adds its section to the summary.

    Returns "" or the error. A disk that does not answer ends each step on it after a minute.
    """
    if is_cancelled():
        return "cancelled"
    name, disk = process_name(module), disk or DiskWork()

    def turn() -> None:
        tick()
        if is_cancelled():
            raise InterruptedError(errno.EINTR, "cancelled")

    try:
        disk.do(lambda: clear_result(run_dir, name), STEP_S, turn)
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
    result = ProcessResult()
    with contextlib.suppress(OSError):  # the end of the run reports this
        result = disk.do(lambda: read_result(run_dir, name), STEP_S, turn)
        disk.do(lambda: update_summary(run_dir, result.summary), STEP_S, turn)
    if code < 0 and not result.error:
        return f"{name} {how_it_ended(code)}"
    return last_error(result, run_dir, module) if code else ""


def _kill(process: Process) -> None:
    """Kill the process and wait at most 5 s: it may hang in a driver."""
    process.kill()
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(_KILL_TIMEOUT_S)


def start_watchdog(
    run_dir: Path, arena_dir: Path, disk: DiskWork | None = None
) -> subprocess.Popen:
    """Start the watchdog, which saves and cleans up after a killed supervisor.

    Raises:
        UserError: the watchdog cannot be started, or its log cannot be written.
    """
    try:
        with open_log(run_dir, WATCHDOG, disk) as log:
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
