"""Converts stamps of a source to the clock of ROS; alone, as the offset of the clocks changes."""

import math

import numpy as np

_TOLERANCE_NS = 5_000_000
_MOST = 10_000  # knots; with more, half of them are left out


class StampClock:
    """Learns the offset of the clocks from frames; it changes when a recording waits, has gaps, or is played
    at another rate. Straight lines between knots are at most 5 ms off the offset of any frame, unless there
    are too many knots."""

    def __init__(self) -> None:
        self._knots: list[tuple[int, int]] = []  # source stamps and offsets
        self._newest = (0, 0)  # the line from the last knot ends here
        # least and greatest slope of a line from the last knot that is within 5 ms of every frame since
        self._slopes = (-math.inf, math.inf)
        # the greatest source stamp, also if the source's clock was set back
        self._latest_ns = -(2**63)

    def learn(self, source_ns: int, ros_ns: int) -> None:
        """Learn from a frame that has both stamps."""
        frame = source_ns, ros_ns - source_ns
        if not self._knots:
            self._knots.append(frame)
        elif not self._continues(frame):
            if self._newest[0] > self._knots[-1][0]:
                self._add_knot(self._newest)
            if not self._continues(frame):  # the source's clock was set back, or repeats a stamp
                self._add_knot(frame)
        self._narrow(frame)
        self._newest = frame
        self._latest_ns = max(self._latest_ns, source_ns)

    def _continues(self, frame: tuple[int, int]) -> bool:
        """Whether the line from the last knot to this frame is within 5 ms of all frames between."""
        (first_ns, offset_ns), (least, most) = self._knots[-1], self._slopes
        run_ns = frame[0] - first_ns
        rise_ns = frame[1] - offset_ns
        if run_ns == 0:
            return abs(rise_ns) <= _TOLERANCE_NS
        return run_ns > 0 and least <= rise_ns / run_ns <= most

    def _narrow(self, frame: tuple[int, int]) -> None:
        (first_ns, offset_ns), (least, most) = self._knots[-1], self._slopes
        if (run_ns := frame[0] - first_ns) > 0:
            rise_ns = frame[1] - offset_ns
            least = max(least, (rise_ns - _TOLERANCE_NS) / run_ns)
            most = min(most, (rise_ns + _TOLERANCE_NS) / run_ns)
            self._slopes = least, most

    def _add_knot(self, frame: tuple[int, int]) -> None:
        if len(self._knots) >= _MOST:
            del self._knots[1::2]
        self._knots.append(frame)
        self._slopes = -math.inf, math.inf

    def is_known(self, source_ns: np.ndarray) -> np.ndarray:
        """Whether a source stamp [n] int64 is not after all frames that the clock has learned from, [n] bool;
        True if it has learned from none."""
        return source_ns <= self._latest_ns if self._knots else np.ones(len(source_ns), bool)

    def ros_ns(self, source_ns: np.ndarray) -> np.ndarray:
        """ROS times [n] int64 of source stamps [n] int64; outside the known range with its nearest offset."""
        if not self._knots:
            return source_ns
        stamps_ns, offsets_ns = np.array([*self._knots, self._newest], np.int64).T
        order = np.argsort(stamps_ns, kind="stable")
        # differences fit into float64 to the nanosecond
        first, some = stamps_ns[order[0]], offsets_ns[0]
        known = (stamps_ns[order] - first, offsets_ns[order] - some)
        return source_ns + some + np.interp(source_ns - first, *known).round().astype(np.int64)
