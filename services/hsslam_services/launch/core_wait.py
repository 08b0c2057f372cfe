"""Finds out whether a silent process hangs, or waits for a core of a busy machine."""

import os
from pathlib import Path
from typing import Final

_LOOK_EVERY_S: Final = 0.2
_FEWEST_LOOKS: Final = 3
# of the looks; threads of a process that sleeps are runnable for moments
_RUNNABLE_SHARE: Final = 0.5
_MOST_CORE_SHARE: Final = 0.5  # with more of a core, a process has had its turn
_TICKS_PER_S: Final = os.sysconf("SC_CLK_TCK")


class CoreWait:
    """Looks at the threads of a process again and again.

    A process that hangs in a lock or a driver has no runnable thread. A process that turns in a loop uses its
    core. A process of low priority on a busy machine is runnable and gets little of a core.

    Args:
        pid: the process, of the same user.
    """

    def __init__(self, pid: int) -> None:
        self._tasks = Path(f"/proc/{pid}/task")
        self._looks = self._runnable = 0
        self._first_s = self._last_s = float("-inf")  # times of looks
        self._first_core_s = self._last_core_s = 0.0  # core time until then

    def look(self, now_s: float) -> None:
        """Look at the threads, at most five times a second; `now_s`: monotonic clock, s."""
        if now_s - self._last_s < _LOOK_EVERY_S:
            return
        is_runnable, core_s = self._threads()
        if not self._looks:
            self._first_s, self._first_core_s = now_s, core_s
        self._looks += 1
        self._runnable += is_runnable
        self._last_s, self._last_core_s = now_s, core_s

    def is_starved(self) -> bool:
        """Whether the process has waited for a core in most looks, and got less than half of one."""
        if self._looks < _FEWEST_LOOKS or self._runnable < _RUNNABLE_SHARE * self._looks:
            return False
        seconds, core_s = self._last_s - self._first_s, self._last_core_s - self._first_core_s
        return core_s < _MOST_CORE_SHARE * seconds

    def _threads(self) -> tuple[bool, float]:
        """Whether a thread is runnable, and the core time of all living threads, s."""
        is_runnable, ticks = False, 0
        for stat in self._tasks.glob("*/stat"):
            try:
                fields = stat.read_text().rpartition(")")[2].split()
            except OSError:  # the thread has ended
                continue
            is_runnable |= fields[0] == "R"
            ticks += int(fields[11]) + int(fields[12])
        return is_runnable, ticks / _TICKS_PER_S
