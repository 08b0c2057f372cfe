"""Waits until the last frame is in the log: the camera's memory holds it; apart, as all paces need it."""

import time

from hsslam_proto import topics
from hsslam_services.launch.worker import Worker

_POLL_S = 0.05
_PATIENCE_S = 2.0  # longest wait for a recorder that is dead or far behind


class LastFrame:
    """Waits until the recorder reports the last frame as logged; create it before the first frame is sent."""

    def __init__(self, worker: Worker, patience_s: float = _PATIENCE_S) -> None:
        self._worker = worker
        self._patience_s = patience_s
        self._steps = worker.bus.subscribe(topics.STEP, 16)

    def wait_until_logged(self, publisher: int, index: int) -> None:
        """Wait until the recorder has logged this frame or a later one, at most `patience_s`.

        The recorder reports this after the end of the source. It does not wait for an index below 0.
        """
        if index < 0:
            return
        give_up_s = time.monotonic() + self._patience_s
        while time.monotonic() < give_up_s and not self._worker.is_orphan():
            step = self._steps.wait(_POLL_S)
            if step is None or step.stage != "logged" or step.publisher != publisher:
                continue
            if step.index >= index:
                return
