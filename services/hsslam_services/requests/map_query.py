"""Requests about places in the map: the mesher answers them, as it has the map and time for it."""

import queue
import threading

from hsslam_proto.request_messages import Refusal
from hsslam_proto.requests import QUERY
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.requests import PendingRequest

_MOST_WAITING = 16  # of a megabyte each


class PassedOnQueries:
    """Passes questions on to the mesher, one after the other; a thread of its own waits for the answers."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._waiting: queue.Queue[PendingRequest] = queue.Queue(_MOST_WAITING)
        self._thread: threading.Thread | None = None

    def ask(self, asked: PendingRequest) -> None:
        """Answer as soon as the mesher has; never blocks."""
        try:
            self._waiting.put_nowait(asked)
        except queue.Full:
            asked.refuse("busy", f"query: {_MOST_WAITING} wait already")
            return
        if self._thread is None:
            self._thread = threading.Thread(target=self._answer_all, name="queries", daemon=True)
            self._thread.start()

    def _answer_all(self) -> None:
        while True:
            asked = self._waiting.get()
            answer = self._bus.pass_on(QUERY, asked.message)
            if isinstance(answer, Refusal):
                asked.refuse(answer.reason, answer.text)
            else:
                asked.answer(answer)
