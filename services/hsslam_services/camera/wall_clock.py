"""The wall clock as an offset from the monotonic one, which it follows when it is set."""

import time

_TIGHT_NS = 50_000  # between two looks at the monotonic clock
_LOOKS = 5
_DRIFT_NS = 2_000_000  # is followed
_STEP_NS = 100_000_000  # is told


class WallClock:
    """Stamps for moments of the monotonic clock; their distances are those of that clock."""

    def __init__(self) -> None:
        self._offset_ns = _offset_ns()

    def at(self, monotonic_ns: int) -> int:
        """The wall clock at this moment, ns, as if it had always been set as it is now."""
        return max(monotonic_ns + self._offset_ns, 0)

    def follow(self) -> float:
        """Take over how the wall clock is set now; by how much it was stepped since the last call, s."""
        step_ns = _offset_ns() - self._offset_ns
        if abs(step_ns) < _DRIFT_NS:
            return 0.0
        self._offset_ns += step_ns
        return step_ns / 1e9 if abs(step_ns) > _STEP_NS else 0.0


def _offset_ns() -> int:
    """From the monotonic clock to the wall clock; of several looks the one that took the least time."""
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
