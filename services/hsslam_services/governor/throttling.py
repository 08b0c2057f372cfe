"""How often the kernel stops this service because its quota of core time is used up."""

from collections import deque
from pathlib import Path
from typing import Final, NamedTuple

from hsslam_services.governor.cpu_groups import GROUPS, OWN_GROUPS, cpu_groups

_WINDOW_S: Final = 10.0
_READ_EVERY_S: Final = 1.0


class _Count(NamedTuple):
    """Numbers since the group was made."""

    periods: int  # in which a process of the group ran
    throttled: int  # of those; the group used up its quota


class Throttling:
    """The share of throttled periods of this process's control groups, the largest of them.

    `own`, `groups`: as in `cpu_groups`.
    """

    def __init__(self, own: Path = OWN_GROUPS, groups: Path = GROUPS) -> None:
        self._files = [file for g in cpu_groups(own, groups) if (file := g / "cpu.stat").exists()]
        self._read: deque[tuple[float, list[_Count]]] = deque()
        self._share = 0.0

    def share(self, now_s: float) -> float:
        """Share of the periods in the last 10 s, 0 to 1; 0 without a quota.

        Call it at least every few seconds. It reads the files once a second.

        `now_s`: monotonic clock, s.
        """
        if not self._files or (self._read and now_s - self._read[-1][0] < _READ_EVERY_S):
            return self._share
        self._read.append((now_s, [_count(file) for file in self._files]))
        while len(self._read) > 2 and now_s - self._read[1][0] >= _WINDOW_S:
            self._read.popleft()
        before, now = self._read[0][1], self._read[-1][1]
        self._share = max(map(_share, before, now))
        return self._share


def _share(before: _Count, now: _Count) -> float:
    return (now.throttled - before.throttled) / max(now.periods - before.periods, 1)


def _count(file: Path) -> _Count:
    """The counts in a `cpu.stat` of version 1 or 2; zeros if it has none, as in a group without a quota."""
    try:
        words = dict(line.split(maxsplit=1) for line in file.read_text().splitlines())
        return _Count(int(words.get("nr_periods", 0)), int(words.get("nr_throttled", 0)))
    except (OSError, ValueError):
        return _Count(0, 0)
