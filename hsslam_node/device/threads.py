"""Parts of a computation at once on the CPU; a file of its own as tracker and mapper share it."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")


class Threads:
    """Makes calls at once, at most `count`; compiled kernels and BLAS let each other run.

    What is computed does not depend on `count`. With 1 there is no thread but the caller's.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._pool: ThreadPoolExecutor | None = None  # begun with the first use: forks come before

    def run(self, calls: Sequence[Callable[[], T]]) -> list[T]:
        """Make all calls; their results in this order, or the first error."""
        if self._count < 2 or len(calls) < 2:
            return [call() for call in calls]
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self._count - 1, "part")
        others = [self._pool.submit(call) for call in calls[1:]]
        try:
            first = calls[0]()
        finally:
            found = [(other.exception(), other) for other in others]  # none is still at work
        for error, _ in found:
            if error is not None:
                raise error
        return [first, *(other.result() for _, other in found)]
