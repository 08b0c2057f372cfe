"""Parallel parts of a computation on the CPU; a file of its own as tracker and mapper share it."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")


class Threads:
    """Runs up to `count` calls in parallel; compiled kernels and BLAS release the GIL.

    Results do not depend on `count`. A count of 1 starts no thread.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._pool: ThreadPoolExecutor | None = None  # made at first use, after forks

    def run(self, calls: Sequence[Callable[[], T]]) -> list[T]:
        """Run all calls; return their results in this order, or raise the first error."""
        if self._count < 2 or len(calls) < 2:
            return [call() for call in calls]
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self._count - 1, "part")
        others = [self._pool.submit(call) for call in calls[1:]]
        try:
            first = calls[0]()
        finally:
            found = [(other.exception(), other) for other in others]  # waits for all
        for error, _ in found:
            if error is not None:
                raise error
        return [first, *(other.result() for _, other in found)]
