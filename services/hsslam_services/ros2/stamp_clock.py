"""Converts stamps of a source to the clock of ROS; alone, as the offset of the clocks changes."""

from collections import deque

import numpy as np

_TOLERANCE_NS = 5_000_000
_MOST = 10_000  # offsets that are remembered


class StampClock:
    """Learns the offset of the clocks from frames; it changes when a recording waits, has gaps, or is played
    at another rate. Between two frames the offset is interpolated."""

    def __init__(self) -> None:
        # source stamps and offsets: the last of a constant offset, and the first of another
        self._steps: deque[tuple[int, int]] = deque(maxlen=_MOST)
        self._newest = (0, 0)
        # the greatest source stamp, also if the source's clock was set back
        self._latest_ns = -(2**63)

    def learn(self, source_ns: int, ros_ns: int) -> None:
        """Learn from a frame that has both stamps."""
        offset_ns = ros_ns - source_ns
        if not self._steps:
            self._steps.append((source_ns, offset_ns))
        elif abs(offset_ns - self._steps[-1][1]) > _TOLERANCE_NS:
            if self._newest[0] > self._steps[-1][0]:
                self._steps.append(self._newest)
            self._steps.append((source_ns, offset_ns))
        self._newest = (source_ns, offset_ns)
        self._latest_ns = max(self._latest_ns, source_ns)

    def is_known(self, source_ns: np.ndarray) -> np.ndarray:
        """Whether a source stamp [n] int64 is not after all frames that the clock has learned from, [n] bool;
        True if it has learned from none."""
        return source_ns <= self._latest_ns if self._steps else np.ones(len(source_ns), bool)

    def ros_ns(self, source_ns: np.ndarray) -> np.ndarray:
        """ROS times [n] int64 of source stamps [n] int64; outside the known range with its nearest offset."""
        if not self._steps:
            return source_ns
        stamps_ns, offsets_ns = np.array(self._steps, np.int64).T
        order = np.argsort(stamps_ns, kind="stable")
        # differences fit into float64 to the nanosecond
        first, some = stamps_ns[order[0]], offsets_ns[0]
        known = (stamps_ns[order] - first, offsets_ns[order] - some)
        return source_ns + some + np.interp(source_ns - first, *known).round().astype(np.int64)
