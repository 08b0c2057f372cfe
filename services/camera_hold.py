"""Whether the run is paused, as the camera hears it."""

import time

from hsslam_node.proto import topics
from hsslam_node.services.worker import Worker

_POLL_S = 0.1


class CameraHold:
    """Listens to `sys/hold`; a restarted camera hears the last word again."""

    def __init__(self, worker: Worker) -> None:
        self._worker = worker
        self._holds = worker.bus.subscribe(topics.HOLD, 4)
        self._is_paused = False

    def wait(self) -> float:
        """Return when frames may be sent, or this worker must stop; seconds waited."""
        start_s = time.monotonic()
        self._hear()
        if not self._is_paused:
            return 0.0
        while self._is_paused and not self._worker.should_stop():
            self._worker.stop_event().wait(_POLL_S)
            self._hear()
        return time.monotonic() - start_s

    def _hear(self) -> None:
        for hold in self._holds.drain():
            self._is_paused = hold.paused
