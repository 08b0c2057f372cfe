"""The loop of a batch: starts waiting attempts as there is room, and retries those that `judge` asks for."""

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol

from hsslam_batch.cluster.task import TaskResult

_LOOK_S = 0.5


@dataclass(frozen=True)
class Try:
    """One attempt at a log that is to start. `not_on`: the node where the previous attempt failed."""

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
        """Whether an attempt is running."""
        ...

    def ended(self, timeout_s: float) -> Iterator[tuple[Try, TaskResult]]:
        """Attempts that have ended since the last call; waits up to `timeout_s` for one."""
        ...


def drive(
    waiting: Iterable[Try],
    pool: Pool,
    judge: Callable[[Try, TaskResult], Try | None],
    is_stopping: Callable[[], bool],
    look: Callable[[], None] = lambda: None,
    clock: Callable[[], float] = time.monotonic,
) -> None:
    """Run all waiting attempts, and those that `judge` returns for attempts that have ended.

    Without a node, attempts wait for one. Once `is_stopping` is true, running attempts finish, and no other
    starts. `look` is called twice a second; `clock`: seconds.
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
