"""Outlives the supervisor by seconds: if it dies without cleaning up, nothing of the run is left.

A process of its own that only waits for the kernel to free the supervisor's lock on the arena.
"""

import argparse
import contextlib
import os
import shutil
import signal
import time
from pathlib import Path

from hsslam_services.arena.arena_folder import wait_for_owner_death

_GRACE_S = 4.0  # for the recorder to finalise its file
_POLL_S = 0.05


def main() -> None:
    """Wait for the supervisor to end; let the others end, kill the rest, free the arena."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    parser = argparse.ArgumentParser(prog="hsslam watchdog")
    parser.add_argument("--run", type=Path, required=True, metavar="DIR", help="the run folder")
    parser.add_argument("--arena", type=Path, required=True, metavar="DIR", help="the arena folder")
    args = parser.parse_args()
    wait_for_owner_death(args.arena)
    if not args.arena.exists():
        return  # an orderly end
    deadline, told = time.monotonic() + _GRACE_S, set()
    while (pids := _processes_of(args.run)) and time.monotonic() < deadline:
        for pid in pids - told:
            _signal(pid, signal.SIGTERM)  # also one that was not yet listening when its parent died
        told |= pids
        time.sleep(_POLL_S)
    for pid in pids:
        _signal(pid, signal.SIGKILL)
    shutil.rmtree(args.arena, ignore_errors=True)


def _processes_of(run_dir: Path) -> set[int]:
    """Processes with a command line as `spawn.module_command` makes it, but this one.

    A forked process shows its command line as one text with spaces, not as separate words.
    """
    of_run = b" --run " + os.fsencode(run_dir)
    found = set()
    for entry in Path("/proc").iterdir():
        if not entry.name.isdecimal() or int(entry.name) == os.getpid():
            continue
        try:
            command = (entry / "cmdline").read_bytes().rstrip(b"\0").replace(b"\0", b" ")
        except OSError:
            continue
        if b" -P -m " in command and (command.endswith(of_run) or of_run + b" " in command):
            found.add(int(entry.name))
    return found


def _signal(pid: int, number: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, number)


if __name__ == "__main__":
    main()
