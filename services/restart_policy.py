"""When a process that failed is started again, and when not any more. Pure; time is an argument."""

from dataclasses import dataclass, field

_MOST_RESTARTS = 5
_WINDOW_S = 300.0


@dataclass
class RestartPolicy:
    """Delays double from `first_delay_s` to `longest_delay_s`; a quiet window starts them anew.

    More than 5 restarts in 300 s are a crash loop.
    """

    first_delay_s: float
    longest_delay_s: float
    _failures_s: list[float] = field(default_factory=list)

    def failed(self, now_s: float) -> float | None:
        """A failure at this time (s, monotonic): seconds to wait, or None to give up."""
        self._failures_s = [t for t in self._failures_s if now_s - t < _WINDOW_S] + [now_s]
        count = len(self._failures_s)
        if count > _MOST_RESTARTS:
            return None
        return min(self.first_delay_s * 2 ** (count - 1), self.longest_delay_s)
