"""Events about frames that cannot be used; a file of its own, since a fault that lasts repeats 30 times a
second."""

import math
import time
from collections.abc import Callable

from hsslam_node.errors import on_one_line
from hsslam_node.sources.source import BadFrame

_AGAIN_S = 5.0
_MOST_REASONS = 4  # that are reported in this time


class SkippedFrames:
    """Reports the first frame of each reason at once, and every 5 s how many more have it.

    `report` gets one line of text. If more than four reasons come in 5 s, the others are counted together.
    """

    def __init__(self, report: Callable[[str], None]) -> None:
        self._report = report
        self._more: dict[str, int] = {}  # frames that are not reported yet, by reason
        self._others = 0  # of reasons beyond those
        self._reported_s = -math.inf

    def add(self, frame: BadFrame) -> None:
        """Count this frame."""
        reason = on_one_line(frame.reason)
        if time.monotonic() - self._reported_s > _AGAIN_S:
            self.report_more()
        if reason in self._more:
            self._more[reason] += 1
        elif len(self._more) < _MOST_REASONS:
            self._more[reason] = 0
            self._report(f"frame {frame.index} skipped: {reason}")
        else:
            self._others += 1

    def report_more(self) -> None:
        """Report the frames that are not reported yet."""
        for reason, count in self._more.items():
            if count:
                self._report(f"{count} more skipped: {reason}")
        if self._others:
            self._report(f"{self._others} more skipped for other reasons")
        self._more = {reason: 0 for reason, count in self._more.items() if count}
        self._others, self._reported_s = 0, time.monotonic()
