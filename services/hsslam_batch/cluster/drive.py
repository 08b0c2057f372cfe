"""The loop of a batch: what waits is started as there is room, what ended badly is perhaps tried again."""

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol

from hsslam_batch.cluster.task import TaskResult

_LOOK_S = 0.5


@dataclass(frozen=True)
class Try:
    """One attempt at a log, to be started. `not_on`: the node where the last attempt ended badly."""

    index: int
    attempt: int = 1
    not_on: str = ""


class Pool(Protocol):
    """Where attempts run."""

    def has_room(self) -> bool:
        """Whether one more may be started now."""
        ...

    def start(self, one: Try) -> None: ...

    def is_busy(self) -> bool:
        """Whether any was started and has not ended."""
        ...

    def ended(self, timeout_s: float) -> Iterator[tuple[Try, TaskResult]]:
        """Attempts that have ended since the last call. It waits for one, `timeout_s` at most."""
        ...


def drive(
    waiting: Iterable[Try],
    pool: Pool,
    judge: Callable[[Try, TaskResult], Try | None],
    is_stopping: Callable[[], bool],
    look: Callable[[], None] = lambda: None,
    clock: Callable[[], float] = time.monotonic,
) -> None:
    """Run all that wait, and what `judge` makes of each that ended: another attempt, or None.

    If no node is there for those that wait, they wait for one. Once it `is_stopping`, those that run end, and
    no other begins. `look` is called twice a second, however many end in between; `clock`: seconds.
    """
    left = deque(waiting)
    due_s = clock()
    while True:
        while left and not is_stopping() and pool.has_room():
            pool.start(left.popleft())
        if not pool.is_busy() and (not left or is_stopping()):
            return
        again = []
        for one, result in pool.ended(_LOOK_S):
            if (more := judge(one, result)) is not None:
                again.append(more)
        left.extendleft(reversed(again))
        if (now_s := clock()) >= due_s:
            due_s = now_s + _LOOK_S
            look()
