"""File work on the run folder in a thread of its own, so that a disk that hangs stops no loop."""

import contextlib
import errno
import os
import threading
import time
from collections.abc import Callable, Generator
from concurrent.futures import Future, wait
from pathlib import Path
from queue import SimpleQueue
from typing import TypeVar

_SHORT_S = 0.05  # most file work takes less, and needs no further turn
_WITHIN_S = 1.0  # that one turn of a loop may wait
STEP_S = 60.0  # for a step at the end of a run: a disk that is busy takes that long for a sync
_HURRIED_S = 5.0  # for any step once the user does not want to wait
_PROBED_EVERY_S = 5.0
_T = TypeVar("_T")


class DiskWork:
    """Does file work in order, in a thread; `do` and `steps` wait for it, for a limited time.

    A disk that hangs delays a loop by one such wait: until it answers, further work is refused at once.
    What it was asked for it may still do later. If no thread can be started, the caller does the work.
    """

    def __init__(self, hurried_s: float = _HURRIED_S) -> None:
        self._hurried_s = hurried_s
        self._waiting: SimpleQueue[tuple[Future, Callable[[], object]]] = SimpleQueue()
        self._thread: threading.Thread | None = None
        self._begun_s: float | None = None  # of the work in progress

    def silent_s(self) -> float:
        """How long the work in progress has taken so far; 0: there is none."""
        begun_s = self._begun_s
        return 0.0 if begun_s is None else time.monotonic() - begun_s

    def ask(self, action: Callable[[], _T]) -> "Future[_T]":
        """Do `action` soon; never blocks."""
        asked: Future[_T] = Future()
        try:
            self._start()
        except (RuntimeError, MemoryError):  # this machine has no thread left
            _finish(asked, action)
        else:
            self._waiting.put((asked, action))
        return asked

    def do(
        self,
        action: Callable[[], _T],
        within_s: float = _WITHIN_S,
        turn: Callable[[], object] | None = None,
        is_hurried: Callable[[], bool] | None = None,
    ) -> _T:
        """Wait for the result of `action`; calls `turn` meanwhile, if it is given.

        Raises:
            TimeoutError: the disk does not answer within `within_s`, or 5 s if `is_hurried()`.
        """
        wait_s = _SHORT_S if turn or is_hurried else within_s
        with contextlib.closing(self.steps(action, within_s, wait_s, is_hurried)) as steps:
            while True:
                try:
                    next(steps)
                except StopIteration as end:
                    return end.value
                if turn is not None:
                    turn()

    def steps(
        self,
        action: Callable[[], _T],
        within_s: float,
        wait_s: float = _SHORT_S,
        is_hurried: Callable[[], bool] | None = None,
    ) -> Generator[None, None, _T]:
        """As `do`, in steps that take at most `wait_s`."""
        begun_s = time.monotonic() - self.silent_s()

        def left_s() -> float:
            is_short = is_hurried is not None and is_hurried()
            limit_s = min(within_s, self._hurried_s) if is_short else within_s
            return begun_s + limit_s - time.monotonic()

        if left_s() > 0:
            asked = self.ask(action)
            try:
                while not asked.done() and (rest_s := left_s()) > 0:
                    wait((asked,), min(wait_s, rest_s))
                    if not asked.done():
                        yield
                if asked.done():
                    return asked.result()
            finally:
                asked.cancel()  # unless it is in progress
        text = f"the disk does not answer for {time.monotonic() - begun_s:.0f} s"
        raise TimeoutError(errno.ETIMEDOUT, text)

    def _start(self) -> None:
        if self._thread is None or not self._thread.is_alive():
            thread = threading.Thread(target=self._work, name="disk work", daemon=True)
            thread.start()
            self._thread = thread

    def _work(self) -> None:
        while True:
            self._do_next()

    def _do_next(self) -> None:
        asked, action = self._waiting.get()
        if asked.set_running_or_notify_cancel():
            self._begun_s = time.monotonic()
            try:
                _finish(asked, action)
            finally:
                self._begun_s = None


class DiskWatch:
    """Looks every 5 s whether the disk of a folder answers. `news`: lines for the operator."""

    def __init__(self, disk: DiskWork, folder: Path, patience_s: float = _PROBED_EVERY_S) -> None:
        self.news: list[str] = []
        self._disk, self._folder, self._patience_s = disk, folder, patience_s
        self._due_s = 0.0
        self._is_silent = False

    def tick(self) -> None:
        """Look if it is due; never blocks."""
        silent_s = self._disk.silent_s()
        if self._is_silent and not silent_s:
            self._is_silent = False
            self.news.append(f"{self._folder}: the disk answers again")
        elif not self._is_silent and silent_s > self._patience_s:
            self._is_silent = True
            text = "the run goes on, what should be written waits or is lost"
            self.news.append(
                f"{self._folder}: the disk does not answer for {silent_s:.0f} s: {text}"
            )
        elif not silent_s and time.monotonic() >= self._due_s:
            self._due_s = time.monotonic() + _PROBED_EVERY_S
            self._disk.ask(lambda: os.statvfs(self._folder))


def _finish(asked: Future, action: Callable[[], object]) -> None:
    try:
        asked.set_result(action())
    except Exception as error:  # of any kind: it is for the one who asked
        asked.set_exception(error)
