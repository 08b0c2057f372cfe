"""Finds out whether a silent process hangs, or waits for a core of a busy machine."""

from pathlib import Path
from typing import Final

_LOOK_EVERY_S: Final = 0.2
_FEWEST_LOOKS: Final = 3
_RUNNABLE_SHARE: Final = (
    0.5  # of the looks; threads of a process that sleeps are runnable for moments
)
_MOST_CORE_SHARE: Final = 0.5  # with more of a core, a process has had its turn
_TICKS_PER_S: Final = 100  # USER_HZ of Linux


class CoreWait:
    """Looks at the threads of a process again and again.

    A process that hangs in a lock or a driver has no runnable thread. A process that turns in a loop uses its
    core. A process of low priority on a busy machine is runnable and gets little of a core.

    Args:
        pid: the process, of the same user.
        now_s: monotonic clock, s.
    """

    def __init__(self, pid: int, now_s: float, proc: Path = Path("/proc")) -> None:
        self._tasks = proc / str(pid) / "task"
        self._looks = self._runnable = 0
        self._since_s, self._next_s = now_s, now_s
        self._used_s = 0.0
        self._core_s_at_first = 0.0

    def look(self, now_s: float) -> None:
        """Look at the threads, at most five times a second."""
        if now_s < self._next_s:
            return
        self._next_s = now_s + _LOOK_EVERY_S
        is_runnable, core_s = self._threads()
        if not self._looks:
            self._core_s_at_first, self._since_s = core_s, now_s
        self._looks += 1
        self._runnable += is_runnable
        self._used_s = core_s - self._core_s_at_first

    def is_starved(self) -> bool:
        """Whether the process has waited for a core in most looks, and got less than half of one."""
        if self._looks < _FEWEST_LOOKS:
            return False
        seconds = self._next_s - _LOOK_EVERY_S - self._since_s
        is_waiting = self._runnable >= _RUNNABLE_SHARE * self._looks
        return is_waiting and self._used_s < _MOST_CORE_SHARE * seconds

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
