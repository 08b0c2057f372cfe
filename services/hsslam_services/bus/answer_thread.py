"""A thread that computes and sends answers: a client that does not read cannot block the supervisor."""

import queue
import sys
import threading
from collections.abc import Callable

_LONGEST_QUEUE = 64
_END_TIMEOUT_S = 2.0


class AnswerThread:
    """Runs jobs in order. A client that does not read delays the others for about 1 s, then zenoh cuts
    its link.
    """

    def __init__(self) -> None:
        self._jobs: queue.Queue[Callable[[], object] | None] = queue.Queue(_LONGEST_QUEUE)
        self._thread = threading.Thread(target=self._work, name="answers", daemon=True)
        self._thread.start()

    def do(self, job: Callable[[], object]) -> bool:
        """Queue a job without blocking; False if the queue is full."""
        try:
            self._jobs.put_nowait(job)
        except queue.Full:
            return False
        return True

    def close(self) -> None:
        """Finish the queued jobs, for at most 4 s, and end."""
        try:
            self._jobs.put(None, timeout=_END_TIMEOUT_S)
        except queue.Full:
            return
        self._thread.join(_END_TIMEOUT_S)

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            try:
                job()
            except Exception as error:  # the thread goes on with other answers
                print(f"error: an answer was not sent: {error}", file=sys.stderr, flush=True)
