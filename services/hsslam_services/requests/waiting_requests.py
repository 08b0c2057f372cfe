"""A queue of requests whose answers take time; a thread answers them one after the other."""

import queue
import threading
from collections.abc import Callable

from hsslam_node.errors import one_line
from hsslam_services.bus.requests import PendingRequest

_MOST_WAITING = 16  # up to a megabyte each


class WaitingRequests:
    """Calls `answer` for each request in turn; if that raises, it refuses the request and goes on.

    The thread starts with the first request; a request for which it cannot start is refused.
    """

    def __init__(self, name: str, answer: Callable[[PendingRequest], None]) -> None:
        self._name = name
        self._answer = answer
        self._waiting: queue.Queue[PendingRequest] = queue.Queue(_MOST_WAITING)
        self._thread: threading.Thread | None = None

    def add(self, asked: PendingRequest) -> bool:
        """Answer the request soon, and return True. If too many wait, or no thread starts, refuse it and
        return False. Never blocks."""
        try:
            self._start()
            self._waiting.put_nowait(asked)
        except queue.Full:
            asked.refuse("busy", f"{asked.request.name}: {_MOST_WAITING} requests wait already")
        except (RuntimeError, MemoryError) as error:  # this machine has no thread left
            asked.refuse("failed", f"{asked.request.name}: {one_line(error)}")
        else:
            return True
        return False

    def _start(self) -> None:
        if self._thread is None:
            thread = threading.Thread(target=self._work, name=self._name, daemon=True)
            thread.start()
            self._thread = thread

    def _work(self) -> None:
        while True:
            asked = self._waiting.get()
            try:
                self._answer(asked)
            except Exception as error:  # of any kind: the client waits for an answer
                asked.refuse("failed", f"{asked.request.name}: {error}")
