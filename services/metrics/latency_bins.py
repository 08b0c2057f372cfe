"""A histogram of latencies, as Prometheus has them."""

from bisect import bisect_left

BOUNDS_MS = (5, 10, 15, 20, 25, 33, 50, 75, 100, 150, 200, 300, 500, 1000)


class LatencyBins:
    """Counts of latencies up to each bound, and their sum."""

    def __init__(self) -> None:
        self.sum_ms = 0.0
        self._counts = [0] * (len(BOUNDS_MS) + 1)  # the last: above all bounds

    def add(self, latency_ms: float) -> None:
        """Count one."""
        self._counts[bisect_left(BOUNDS_MS, latency_ms)] += 1
        self.sum_ms += latency_ms

    def cumulative(self) -> list[int]:
        """How many were at most so long, for each bound, and how many there were."""
        total = 0
        return [total := total + count for count in self._counts]
