"""The watchdog: if the supervisor dies without an orderly end, saves the results in the arena and removes it.

This process waits until the kernel frees the supervisor's lock on the arena.
"""

import argparse
import contextlib
import os
import signal
import sys
import time
from collections.abc import Iterable
from pathlib import Path

from hsslam_node.durable_file import remove_partial_files
from hsslam_node.errors import UserError
from hsslam_services.arena.arena_folder import owned_after_death, pose_count, remove_arena
from hsslam_services.arena.process_registry import living_processes
from hsslam_services.arena.unsaved_marker import (
    ARENA_ARTEFACTS,
    is_marked,
    leave_to_user,
    mark_unsaved,
)
from hsslam_services.bus.dead_pools import remove_unused_pools
from hsslam_services.run.stop_signals import END_SIGNAL

_GRACE_S = 4.0  # for the processes to end; the recorder has longer
_LONGEST_RECORDER_S = 30.0
_POLL_S = 0.02
_RECORDER = "recorder"  # name in the registry


def main() -> None:
    """Wait for the end of the supervisor; end or kill the other processes, save and remove the arena."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    parser = argparse.ArgumentParser(prog="hsslam watchdog")
    parser.add_argument("--run", type=Path, required=True, metavar="DIR", help="the run folder")
    parser.add_argument("--arena", type=Path, required=True, metavar="DIR", help="the arena folder")
    args = parser.parse_args()
    with owned_after_death(args.arena) as is_there:
        if is_there and not is_marked(args.arena):  # else it was an orderly end
            _save_and_remove(args.arena, args.run)
            remove_unused_pools()


def _save_and_remove(arena_dir: Path, run_dir: Path) -> None:
    with contextlib.suppress(OSError):  # the memory is full; this process owns the arena anyway
        mark_unsaved(arena_dir, run_dir, ARENA_ARTEFACTS, is_being_saved=True)
    for pid in living_processes(arena_dir):
        _signal(pid, END_SIGNAL)  # a process may have had no handler when its parent died
    from hsslam_services.artefacts.replaced_results import ReplacedResults  # late: saves memory

    before = ReplacedResults(run_dir)
    # the supervisor removes the previous results once its run has a second pose or a map
    if pose_count(arena_dir) > (1 if before.exists else 0):
        _save(arena_dir, run_dir)
    else:
        _kill(_wait_for_end(arena_dir))
        with contextlib.suppress(OSError):  # if this fails, the next run in this folder does it
            before.give_back()
        remove_arena(arena_dir)


def _save(arena_dir: Path, run_dir: Path) -> None:
    """Save all results; if this fails, the arena stays and is marked as unsaved."""
    from hsslam_services.artefacts.lost_results import lost_results
    from hsslam_services.artefacts.rescue import rescue  # while they end: PyTorch takes 1 s
    from hsslam_services.run.process_result import read_result
    from hsslam_services.run.summary import update_summary

    recorders = _wait_for_end(arena_dir)
    try:
        not_saved = rescue(arena_dir, run_dir, _report)
        deadline = time.monotonic() + _LONGEST_RECORDER_S
        while recorders & living_processes(arena_dir).keys() and time.monotonic() < deadline:
            time.sleep(_POLL_S)
        log = read_result(run_dir, "recorder").summary
        lost = lost_results(run_dir)
        for name, why in lost.items():
            _report(f"{name} not saved: {why}")
        reason = {"stop_reason": "the supervisor crashed or was killed"}
        update_summary(run_dir, {**log, **reason, "not_saved": {**not_saved, **lost}})
    except (UserError, OSError) as error:
        _report(f"error: {error}")
        leave_to_user(arena_dir, run_dir)
        return
    _kill(living_processes(arena_dir))
    remove_partial_files(run_dir)
    if not not_saved:
        remove_arena(arena_dir)


def _wait_for_end(arena_dir: Path) -> set[int]:
    """Wait for the processes of the arena, kill those that do not end; returns recorders that still write."""
    deadline = time.monotonic() + _GRACE_S
    while (living := living_processes(arena_dir)) and time.monotonic() < deadline:
        recorders = {pid for pid, name in living.items() if name == _RECORDER}
        if living.keys() == recorders:
            return recorders
        for pid in living.keys() - recorders:
            _signal(pid, END_SIGNAL)
        time.sleep(_POLL_S)
    recorders = {pid for pid, name in living.items() if name == _RECORDER}
    _kill(living.keys() - recorders)
    return recorders


def _kill(pids: Iterable[int]) -> None:
    for pid in pids:
        _signal(pid, signal.SIGKILL)


def _signal(pid: int, number: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, number)


def _report(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
