"""Latencies of poses without steps of a clock; apart, as status and summary must leave out the same."""

from typing import Final

_SLACK_S: Final = 1.0  # by which a pose may be heard late: the loop of the supervisor takes 50 ms


class KnownLatencies:
    """Tells latencies of poses, in their order, from steps of a clock.

    A latency grows by no more than the time since the pose before. If it grows by more, or is far below 0, a
    clock was set while the frame was in flight, and the latency is not known.
    """

    def __init__(self) -> None:
        self._latest: tuple[float, float] | None = None  # known latency, ms, and its time, s

    def of(self, stamp_ns: int, publish_ns: int, at_s: float) -> float | None:
        """Latency of the next pose, ms, 0 or more; None: a clock was set.

        `stamp_ns`, `publish_ns`: by the wall clock, of the sensor and of the pose. `at_s`: time of
        publication, perhaps a little later, by the monotonic clock, s.
        """
        latency_ms = (publish_ns - stamp_ns) / 1e6
        if latency_ms < -1e3 * _SLACK_S:
            return None
        if self._latest is not None:
            before_ms, before_s = self._latest
            if latency_ms - before_ms > 1e3 * (at_s - before_s + _SLACK_S):
                return None
        self._latest = max(latency_ms, 0.0), at_s  # the clock of a camera may be a little ahead
        return self._latest[0]
