"""Events about frames that cannot be used; a file of its own, since a fault that lasts repeats 30 times a
second."""

import time
from collections.abc import Callable

from hsslam_node.errors import on_one_line
from hsslam_node.sources.source import BadFrame

_AGAIN_S = 5.0


class SkippedFrames:
    """Reports the first frame of each reason at once, and every 5 s how many more have it.

    `report` gets one line of text.
    """

    def __init__(self, report: Callable[[str], None]) -> None:
        self._report = report
        self._reason = ""
        self._more = 0
        self._reported_s = 0.0

    def add(self, frame: BadFrame) -> None:
        """Count this frame."""
        reason = on_one_line(frame.reason)
        if reason != self._reason:
            self.report_more()
            self._reason, self._reported_s = reason, time.monotonic()
            self._report(f"frame {frame.index} skipped: {reason}")
            return
        self._more += 1
        if time.monotonic() - self._reported_s > _AGAIN_S:
            self.report_more()

    def report_more(self) -> None:
        """Report the frames of the last reason that are not reported yet."""
        if self._more:
            self._report(f"{self._more} more skipped: {self._reason}")
        self._more, self._reported_s = 0, time.monotonic()
