"""The wall clock as an offset from the monotonic clock, adjusted when the wall clock is set."""

import time

_TIGHT_NS = 50_000  # between two reads of the monotonic clock
_LOOKS = 5
_DRIFT_NS = 2_000_000  # smaller changes are ignored
_STEP_NS = 100_000_000  # larger changes are reported


class WallClock:
    """Converts times of the monotonic clock to the wall clock; intervals stay monotonic."""

    def __init__(self) -> None:
        self._offset_ns = _offset_ns()

    def at(self, monotonic_ns: int) -> int:
        """The wall clock at a monotonic time, ns, by the newest offset."""
        return max(monotonic_ns + self._offset_ns, 0)

    def follow(self) -> float:
        """Adopt the present offset; returns the wall clock's step since the last call, s, 0 below 0.1 s."""
        step_ns = _offset_ns() - self._offset_ns
        if abs(step_ns) < _DRIFT_NS:
            return 0.0
        self._offset_ns += step_ns
        return step_ns / 1e9 if abs(step_ns) > _STEP_NS else 0.0


def _offset_ns() -> int:
    """Offset from the monotonic to the wall clock, ns, from the quickest of several reads."""
    best: tuple[int, int] | None = None
    for _ in range(_LOOKS):
        before_ns = time.monotonic_ns()
        wall_ns = time.time_ns()
        took_ns = time.monotonic_ns() - before_ns
        found = took_ns, wall_ns - before_ns
        best = found if best is None else min(best, found)
        if took_ns < _TIGHT_NS:
            break
    assert best is not None
    return best[1]
