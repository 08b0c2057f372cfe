"""Converts stamps of a source to the clock of ROS; alone, as the offset of the clocks changes."""

from collections import deque

import numpy as np

_TOLERANCE_NS = 5_000_000
_MOST = 10_000  # offsets that are remembered


class StampClock:
    """Learns the offset of the clocks from frames; it changes when a recording waits or has gaps."""

    def __init__(self) -> None:
        self._steps: deque[tuple[int, int]] = deque(
            maxlen=_MOST
        )  # source stamp, offset from then on

    def learn(self, source_ns: int, ros_ns: int) -> None:
        """Learn from a frame that has both stamps."""
        offset_ns = ros_ns - source_ns
        if not self._steps or abs(offset_ns - self._steps[-1][1]) > _TOLERANCE_NS:
            self._steps.append((source_ns, offset_ns))

    def ros_ns(self, source_ns: np.ndarray) -> np.ndarray:
        """ROS times [n] int64 of source stamps [n] int64; outside the known range with its nearest offset."""
        if not self._steps:
            return source_ns
        since_ns, offset_ns = np.array(self._steps, np.int64).T
        order = np.argsort(since_ns, kind="stable")
        at = np.searchsorted(since_ns[order], source_ns, side="right") - 1
        return source_ns + offset_ns[order][np.maximum(at, 0)]
