"""The end of a camera waits for the log, apart from its pace: frames on their way go with its memory."""

import time

from hsslam_proto import topics
from hsslam_services.launch.worker import Worker

_POLL_S = 0.05
_PATIENCE_S = 2.0  # for a recorder that is dead, or far behind


class LastFrame:
    """Hears from the recorder that the last frame is in the log; made before the first frame goes out."""

    def __init__(self, worker: Worker, patience_s: float = _PATIENCE_S) -> None:
        self._worker = worker
        self._patience_s = patience_s
        self._steps = worker.bus.subscribe(topics.STEP, 16)

    def wait_until_logged(self, publisher: int, index: int) -> None:
        """Return when the recorder has this frame or a later one, or after `patience_s`.

        The recorder answers once it has heard that the source has ended.
        """
        give_up_s = time.monotonic() + self._patience_s
        while time.monotonic() < give_up_s and not self._worker.is_orphan():
            step = self._steps.wait(_POLL_S)
            if step is None or step.stage != "logged" or step.publisher != publisher:
                continue
            if step.index >= index:
                return
