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
        self._own, self._groups = own, groups
        self._read: deque[tuple[float, dict[Path, _Count]]] = deque()
        self._share = 0.0

    def share(self, now_s: float) -> float:
        """Share of the periods in the last 10 s, 0 to 1; 0 without a quota.

        Call it at least every few seconds. It reads the counts once a second, and begins anew if this process
        has moved to other groups or a count has begun anew.

        `now_s`: monotonic clock, s.
        """
        if self._read and now_s - self._read[-1][0] < _READ_EVERY_S:
            return self._share
        counts = self._counts()
        if self._read and not _continues(self._read[-1][1], counts):
            self._read.clear()
        self._read.append((now_s, counts))
        while len(self._read) > 2 and now_s - self._read[1][0] >= _WINDOW_S:
            self._read.popleft()
        before = self._read[0][1]
        self._share = max((_share(before[g], counts[g]) for g in counts), default=0.0)
        return self._share

    def _counts(self) -> dict[Path, _Count]:
        found = (
            (group, _count(group / "cpu.stat")) for group in cpu_groups(self._own, self._groups)
        )
        return {group: count for group, count in found if count is not None}


def _continues(before: dict[Path, _Count], now: dict[Path, _Count]) -> bool:
    return before.keys() == now.keys() and all(
        a >= b for group in now for a, b in zip(now[group], before[group], strict=True)
    )


def _share(before: _Count, now: _Count) -> float:
    return (now.throttled - before.throttled) / max(now.periods - before.periods, 1)


def _count(stat: Path) -> _Count | None:
    """The counts in a `cpu.stat` of version 1 or 2; None if it has none, as in a group without a quota."""
    try:
        words = dict(line.split(maxsplit=1) for line in stat.read_text().splitlines())
        return _Count(int(words["nr_periods"]), int(words["nr_throttled"]))
    except (OSError, ValueError, KeyError):
        return None
