"""A thread that computes and sends answers: no client that does not read holds up the supervisor's loop."""

import queue
import sys
import threading
from collections.abc import Callable

_LONGEST_QUEUE = 64
_END_TIMEOUT_S = 2.0


class AnswerThread:
    """Does jobs one after the other; a client that takes nothing holds up other answers for about a second.

    After that time zenoh cuts its link.
    """

    def __init__(self) -> None:
        self._jobs: queue.Queue[Callable[[], object] | None] = queue.Queue(_LONGEST_QUEUE)
        self._thread = threading.Thread(target=self._work, name="answers", daemon=True)
        self._thread.start()

    def do(self, job: Callable[[], object]) -> bool:
        """Do it soon; False if too many wait already. Never blocks."""
        try:
            self._jobs.put_nowait(job)
        except queue.Full:
            return False
        return True

    def close(self) -> None:
        """Do what waits, if that does not take long, and end."""
        try:
            self._jobs.put(None, timeout=_END_TIMEOUT_S)
        except queue.Full:
            return
        self._thread.join(_END_TIMEOUT_S)

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            try:
                job()
            except Exception as error:  # an answer that fails costs no other answer
                print(f"error: an answer was not sent: {error}", file=sys.stderr, flush=True)
