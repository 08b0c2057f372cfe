"""Runs a command, ends it at a limit of time or memory, and leaves none of its processes.

The watching process adopts the orphans of its descendants (it is a subreaper), so it finds all of them after
any end of the command. It runs no thread, so the kernel sends SIGTERM to the command when this process dies,
and not earlier.
"""

import contextlib
import os
import resource
import select
import signal
import subprocess
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import psutil

from hsslam_services.bus.dead_pools import pools_of
from hsslam_services.launch.parent_death import adopt_orphans, die_with_parent
from hsslam_services.run.memory import oom_kills, read_pss_mb
from hsslam_services.run.stop_signals import ONE_REQUEST_S

_LOOK_S = 1.0
_MEMORY_EVERY_S = 2.0  # the kernel walks all pages to measure PSS
_GRACE_S = 10.0  # from the second SIGTERM to SIGKILL
_BETWEEN_SIGNALS_S = 1.2 * ONE_REQUEST_S  # else they count as one request
_KILLING_S = 60.0  # until descendants that do not die are left

Why = Literal["", "timeout", "memory", "cancelled"]


@dataclass(frozen=True)
class Limits:
    """Time and memory that a command may take; None: no limit."""

    timeout_s: float | None = None
    memory_gb: float | None = None  # of all processes together (PSS)

    def after(self, wall_s: float) -> "Limits":
        """The limits of a second command, after the first has taken `wall_s`."""
        if self.timeout_s is None:
            return self
        return replace(self, timeout_s=self.timeout_s - wall_s)


@dataclass(frozen=True)
class End:
    """How a command ended. `why`: the reason to end it; empty if it ended by itself.

    `oom_kills`: how many processes of the machine the kernel has killed meanwhile for lack of memory.
    """

    code: int
    why: Why
    wall_s: float
    core_s: float
    memory_mb: int
    oom_kills: int = 0


def watch(
    command: Sequence[str],
    output: Path,
    limits: Limits,
    cancel_fds: Sequence[int] = (),
    look: Callable[[], None] = lambda: None,
) -> End:
    """Run a command, write its output to a file, and leave none of its processes.

    The command is ended when one of `cancel_fds` becomes readable or closes. `look` is called once a second.
    """
    adopt_orphans()
    start_s, core_s, kills = time.monotonic(), _core_s(), oom_kills()
    with output.open("wb") as stream:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=stream,
            stderr=stream,
            start_new_session=True,
            preexec_fn=_end_with_watcher,  # no thread runs here
        )
    end_fd = os.pidfd_open(process.pid)
    memory = _Memory(limits.memory_gb)
    why: Why = ""
    try:
        while not why and process.poll() is None:
            if limits.timeout_s is not None and time.monotonic() - start_s > limits.timeout_s:
                why = "timeout"
            elif memory.is_too_much():
                why = "memory"
            else:
                look()
                ready = select.select([end_fd, *cancel_fds], [], [], _LOOK_S)[0]
                why = "cancelled" if any(fd in ready for fd in cancel_fds) else ""
    finally:
        below = psutil.Process().children(recursive=True)
        pools = [pools_of(each.pid) for each in below]  # killed processes leave them behind
        _end(process)
        os.close(end_fd)
        _kill_all()
        for pool in set().union(*pools):
            pool.unlink(missing_ok=True)
    wall_s = time.monotonic() - start_s
    code = -signal.SIGKILL if process.returncode is None else process.returncode
    return End(code, why, wall_s, _core_s() - core_s, memory.peak_mb, oom_kills() - kills)


class _Memory:
    """The memory of all descendants, measured every `_MEMORY_EVERY_S`."""

    def __init__(self, most_gb: float | None) -> None:
        self._most_mb = None if most_gb is None else 1e3 * most_gb
        self._due_s = 0.0
        self.peak_mb = 0

    def is_too_much(self) -> bool:
        if time.monotonic() >= self._due_s:
            self._due_s = time.monotonic() + _MEMORY_EVERY_S
            below = psutil.Process().children(recursive=True)
            self.peak_mb = max(self.peak_mb, sum(read_pss_mb(p.pid) for p in below))
        return self._most_mb is not None and self.peak_mb > self._most_mb


def _end_with_watcher() -> None:
    """In the new process: unblock the signals that the watcher blocks; die with the watcher."""
    signal.pthread_sigmask(signal.SIG_SETMASK, ())
    die_with_parent(signal.SIGTERM)


def _end(process: subprocess.Popen) -> None:
    """Send SIGTERM twice, as a user who presses Ctrl-C twice; after 10 s kill the process."""
    for _ in range(2):
        if process.poll() is None:
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(_BETWEEN_SIGNALS_S)
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(_GRACE_S)
    process.kill()
    with contextlib.suppress(subprocess.TimeoutExpired):  # it waits for a disk that does not answer
        process.wait(_GRACE_S)


def _kill_all() -> None:
    """Kill and reap all descendants, including orphans adopted meanwhile, until none is left.

    Gives up after `_KILLING_S`: a process that waits for a disk or device that does not answer cannot die.
    """
    deadline_s = time.monotonic() + _KILLING_S
    while (below := psutil.Process().children(recursive=True)) and time.monotonic() < deadline_s:
        for process in below:
            with contextlib.suppress(psutil.Error):
                process.kill()
        psutil.wait_procs(below, timeout=_GRACE_S)


def _core_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
