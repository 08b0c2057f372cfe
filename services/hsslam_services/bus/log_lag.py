"""Lockstep: how far the recorder is behind the camera."""

import time
from collections import deque

from hsslam_proto.run_messages import Step

_MOST_FRAMES = 8  # half of what the recorder keeps waiting
_PATIENCE_S = 10.0


class LogLag:
    """Frames that were sent and are not in the log yet; whoever sends waits while they are too many.

    A recorder that logs nothing for 10 s is not waited for, until it logs again.
    `has_recorder`: it takes work already.
    """

    def __init__(self, has_recorder: bool) -> None:
        self._has_recorder = has_recorder
        self._unlogged: deque[tuple[int, int]] = deque(maxlen=_MOST_FRAMES)
        self._since_s = time.monotonic()

    def sent(self, publisher: int, index: int) -> None:
        """A frame has gone out for the first time."""
        self._unlogged.append((publisher, index))

    def hear(self, step: Step) -> None:
        """Take in a step: a frame that is logged stands for all before it."""
        if step.stage != "logged":
            return
        self._has_recorder, self._since_s = True, time.monotonic()
        frame = step.publisher, step.index
        if frame in self._unlogged:
            while self._unlogged.popleft() != frame:
                pass

    def must_wait(self) -> bool:
        """Whether the next frame could be lost to the log."""
        if not self._has_recorder or len(self._unlogged) < _MOST_FRAMES:
            self._since_s = time.monotonic()
            return False
        if time.monotonic() - self._since_s > _PATIENCE_S:
            self.forget()
        return bool(self._unlogged)

    def is_over(self) -> bool:
        """Whether all that was sent is in the log, if a recorder is there."""
        return not self._has_recorder or not self._unlogged

    def forget(self) -> None:
        """The recorder is gone, and with it what waited there."""
        self._has_recorder = False
        self._unlogged.clear()
