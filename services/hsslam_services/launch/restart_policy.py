"""When to restart a failed process, and when to give up; apart, as it needs no process."""

from dataclasses import dataclass, field

_MOST_RESTARTS = 5
_WINDOW_S = 300.0
_SOUND_S = 20.0


@dataclass
class RestartPolicy:
    """Computes the delay of the next restart; it reads no clock.

    Delays double from `first_delay_s` to `longest_delay_s`. After 20 s of work, a failure counts as the
    first. More than 5 restarts in 300 s without such a time are a crash loop.
    """

    first_delay_s: float
    longest_delay_s: float
    _failures_s: list[float] = field(default_factory=list)

    def failed(self, now_s: float, worked_s: float = 0.0) -> float | None:
        """Delay of the restart, s, after a failure at `now_s` and `worked_s` of work; None: give up."""
        if worked_s >= _SOUND_S:
            self._failures_s.clear()
        self._failures_s = [t for t in self._failures_s if now_s - t < _WINDOW_S] + [now_s]
        count = len(self._failures_s)
        if count > _MOST_RESTARTS:
            return None
        return min(self.first_delay_s * 2 ** (count - 1), self.longest_delay_s)
