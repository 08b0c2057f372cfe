"""How late the frames of a recording come because its disk is slow, which no load level changes."""

import contextlib
import os
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple, Self

from hsslam_node.frame import Frame
from hsslam_node.sources.source import BadFrame

_LINE_BYTES: Final = 96
_LEAST_SHARE: Final = 0.25  # of the time of a read, that is a wait of the source


@dataclass(frozen=True)
class ReadItem:
    """An item of a source.

    `lag_ns`: how late it was read. `wait_ns`: the part of it for which the source waited, as for a disk, and
    neither ran nor waited for a core.
    """

    item: Frame | BadFrame
    lag_ns: int = 0
    wait_ns: int = 0

    @property
    def is_late_by_wait(self) -> bool:
        """Whether it is late mainly because the source waited."""
        return 2 * self.wait_ns > self.lag_ns


class SourceWaits:
    """Tells frames that come late because their source waits from those for which a core is short.

    While a source is late, its waits add up; what it makes up for is forgotten. If the system does not tell
    how long threads wait for a core, no wait counts.

    `lag_ns(stamp_ns)`: how late a frame of this stamp would come now, ns; below 0: before its time.
    """

    def __init__(self, lag_ns: Callable[[int], int]) -> None:
        self._lag_ns = lag_ns

    def timed(self, items: Iterable[Frame | BadFrame]) -> Iterator[ReadItem]:
        """The items of a source; the thread that reads them makes the iterator."""
        wait_ns = 0
        with _IdleTime() as idle:
            for item in items:
                lag_ns = max(self._lag_ns(item.stamp_ns), 0)
                read = idle.since_last()
                before_ns = max(lag_ns - read.wall_ns, 0)  # lag when the read began
                wait_ns = min(min(wait_ns, before_ns) + read.idle_ns, lag_ns)
                yield ReadItem(item, lag_ns, wait_ns)
                idle.since_last()  # the taker's time


class _IdleTime:
    """The time in which this thread neither runs nor waits for a core.

    While the main thread waits for a core, it may hold the interpreter's lock: this is no idle time either.
    """

    def __init__(self) -> None:
        self._files: list[int] = []
        for thread in (f"/proc/self/task/{os.getpid()}", "/proc/thread-self"):
            with contextlib.suppress(OSError):
                self._files.append(os.open(f"{thread}/schedstat", os.O_RDONLY | os.O_CLOEXEC))
        # zeros: the system does not count; those of a new thread may be zeros anyway
        self._is_known = len(self._files) == 2 and _schedstat(self._files[0]).ran_ns > 0
        self._last_ns = self._times_ns()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for file in self._files:
            os.close(file)

    def since_last(self) -> "_Passed":
        """Since the last call; no idle time if the system does not tell, or if it is a small part, as by
        locks."""
        before_ns, self._last_ns = self._last_ns, self._times_ns()
        wall_ns, busy_ns = (a - b for a, b in zip(self._last_ns, before_ns, strict=True))
        idle_ns = wall_ns - busy_ns
        is_idle = self._is_known and idle_ns > _LEAST_SHARE * wall_ns
        return _Passed(wall_ns, idle_ns if is_idle else 0)

    def _times_ns(self) -> tuple[int, int]:
        """Since any moment: all time, and that in which the thread runs or waits for a core, ns."""
        waited_ns = sum(_schedstat(file).waited_ns for file in self._files)
        return time.monotonic_ns(), time.thread_time_ns() + waited_ns


class _Passed(NamedTuple):
    wall_ns: int
    idle_ns: int


class _Schedstat(NamedTuple):
    ran_ns: int
    waited_ns: int  # for a core


def _schedstat(file: int) -> _Schedstat:
    """What the system counts of a thread, of its open file `schedstat`."""
    ran_ns, waited_ns, _ = os.pread(file, _LINE_BYTES, 0).split()
    return _Schedstat(int(ran_ns), int(waited_ns))
