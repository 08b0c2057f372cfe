"""An iterator that computes a bounded number of items ahead in its own thread."""

import queue
import threading
from collections.abc import Callable, Iterable, Iterator
from typing import Generic, TypeVar

T = TypeVar("T")
_END = object()
_POLL_S = 0.2
_CLOSE_S = 5.0  # an item may take longer, such as the first one of a bag that resumes late


class Prefetch(Generic[T]):
    """Iterates over `items`, computed up to `depth` ahead; re-raises their errors.

    `close` stops the thread, for a consumer that stops early. While there is no next item, `waiting` is
    called every 0.2 s; if it returns True, the iteration ends.
    """

    def __init__(
        self, items: Iterable[T], depth: int, waiting: Callable[[], bool] = lambda: False
    ) -> None:
        self._waiting = waiting
        self._queue: queue.Queue = queue.Queue(depth)
        self._closed = threading.Event()
        self._thread = threading.Thread(
            target=self._run, args=(items,), name="prefetch", daemon=True
        )
        self._thread.start()

    def __iter__(self) -> Iterator[T]:
        while True:
            try:
                item = self._queue.get(timeout=_POLL_S)
            except queue.Empty:
                if self._waiting():
                    return
                continue
            if item is _END:
                return
            if isinstance(item, Exception):
                raise item
            yield item

    def close(self) -> None:
        self._closed.set()
        self._thread.join(_CLOSE_S)

    def _run(self, items: Iterable[T]) -> None:
        try:
            for item in items:
                if not self._put(item):
                    return
            self._put(_END)
        except Exception as error:
            self._put(error)
        except BaseException as error:
            # such as `sys.exit` in a plugin, which ends this thread alone
            self._put(RuntimeError(repr(error)))

    def _put(self, item: object) -> bool:
        while not self._closed.is_set():
            try:
                self._queue.put(item, timeout=_POLL_S)
                return True
            except queue.Full:
                continue
        return False
