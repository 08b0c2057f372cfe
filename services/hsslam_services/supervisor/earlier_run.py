"""The previous run in the same folder: waits until its results are saved."""

import sys
import time
from collections.abc import Callable
from pathlib import Path

from hsslam_node.errors import UserError
from hsslam_services.arena.arena_folder import owner_lives, try_own
from hsslam_services.arena.unsaved_marker import is_marked, leave_to_user
from hsslam_services.run.run_info import RunInfo

_LONGEST_RESCUE_S = 600.0
_POLL_S = 0.05
_NO_WATCHDOG_S = 10.0  # a watchdog that was started takes the lock of the arena in this time


def wait_for_earlier_run(run_dir: Path, is_cancelled: Callable[[], bool]) -> None:
    """Wait until no process of an earlier run writes to the folder.

    Raises:
        UserError: another run uses the folder, or its results are not saved in time.
        KeyboardInterrupt: cancelled while it waits.
    """
    try:
        arena_dir = Path(RunInfo.read(run_dir).arena_dir)
    except UserError:
        return  # no run, or of another version: no process of ours writes there
    if not arena_dir.exists():
        return
    if owner_lives(arena_dir):
        raise UserError(f"--out {run_dir}: in use by another run: expected another folder")
    _wait_for_rescue(run_dir, arena_dir, is_cancelled)


def _wait_for_rescue(run_dir: Path, arena_dir: Path, is_cancelled: Callable[[], bool]) -> None:
    """The watchdog of the earlier run owns the arena while it saves."""
    deadline_s = time.monotonic() + _LONGEST_RESCUE_S
    owned_s = time.monotonic()
    is_reported = False
    while not _is_left(arena_dir):
        if not _is_free(arena_dir):
            owned_s = time.monotonic()
        elif time.monotonic() > owned_s + _NO_WATCHDOG_S:
            leave_to_user(arena_dir, run_dir)  # its watchdog died again
        if not is_reported:
            is_reported = True
            text = "the previous run was killed: its results are being saved before this run starts"
            print(f"--out {run_dir}: {text}", file=sys.stderr, flush=True)
        if is_cancelled():
            raise KeyboardInterrupt
        if time.monotonic() > deadline_s:
            raise UserError(
                f"--out {run_dir}: the results of the previous run are still being saved: "
                "expected another folder"
            )
        time.sleep(_POLL_S)


def _is_left(arena_dir: Path) -> bool:
    """Whether no process saves from the arena any more: the arena is gone, or kept for the user."""
    return not arena_dir.exists() or (_is_free(arena_dir) and is_marked(arena_dir))


def _is_free(arena_dir: Path) -> bool:
    """Whether no process owns the arena."""
    try:
        with try_own(arena_dir) as is_free:
            return is_free
    except OSError:
        return True
