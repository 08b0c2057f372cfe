"""Lockstep: the camera waits if the recorder falls behind."""

import time
from collections import deque

from hsslam_proto.run_messages import Step

_MOST_FRAMES = 8  # half of the recorder's queue
_PATIENCE_S = 10.0


class LogLag:
    """Counts frames that were sent and are not logged yet; the camera waits while there are too many.

    If the recorder logs nothing for 10 s, the camera does not wait until the recorder logs again.
    `has_recorder`: the recorder takes work already.
    """

    def __init__(self, has_recorder: bool) -> None:
        self._has_recorder = has_recorder
        self._unlogged: deque[tuple[int, int]] = deque(maxlen=_MOST_FRAMES)
        self._since_s = time.monotonic()

    def sent(self, publisher: int, index: int) -> None:
        """Take in a frame that was sent for the first time."""
        self._unlogged.append((publisher, index))

    def hear(self, step: Step) -> None:
        """Take in a step: if a frame is logged, all earlier frames count as logged too."""
        if step.stage != "logged":
            return
        self._has_recorder, self._since_s = True, time.monotonic()
        frame = step.publisher, step.index
        if frame in self._unlogged:
            while self._unlogged.popleft() != frame:
                pass

    def must_wait(self) -> bool:
        """Whether the camera must wait, as the log could miss the next frame."""
        if not self._has_recorder or len(self._unlogged) < _MOST_FRAMES:
            self._since_s = time.monotonic()
            return False
        if time.monotonic() - self._since_s > _PATIENCE_S:
            self.forget()
        return bool(self._unlogged)

    def is_over(self) -> bool:
        """Whether all sent frames are in the log, or there is no recorder."""
        return not self._has_recorder or not self._unlogged

    def forget(self) -> None:
        """The recorder is gone, and its queue with it."""
        self._has_recorder = False
        self._unlogged.clear()
