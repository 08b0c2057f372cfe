"""Faults of a source beside its frames; each kind is reported once, and counted."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from hsslam_node.sources.source import Source

_MOST_WAITING = 1000


@dataclass(frozen=True)
class Report:
    """One fault; `kind`: the name that it is counted by, in a few words."""

    kind: str
    text: str

    @classmethod
    def clock_set_back(cls, topic: str, seconds: float) -> "Report":
        """Stamps of a sensor's messages went back, and not because messages changed order."""
        kind = f"{topic}: clock set back"
        return cls(kind, f"{kind} by {seconds:.1f} s: motion is measured from the new time")

    @classmethod
    def unusable(cls, topic: str, error: Exception) -> "Report":
        """A message of a sensor cannot be used; frames go on without it."""
        return cls(f"{topic}: unusable messages", f"{topic}: {error}; the message is skipped")


class Reports:
    """Reports of a source until they are taken; of too many, the newest."""

    def __init__(self) -> None:
        self._waiting: deque[Report] = deque(maxlen=_MOST_WAITING)

    def add(self, report: Report) -> None:
        """Keep it for the next `take`."""
        self._waiting.append(report)

    def take(self) -> list[Report]:
        """All reports since the last call."""
        return [self._waiting.popleft() for _ in range(len(self._waiting))]


def clock_watch(topic: str, tell: Callable[[Report], None]) -> Callable[[float], None]:
    """A callback for a track, with the seconds that stamps of this topic went back; `tell` gets a report."""
    return lambda seconds: tell(Report.clock_set_back(topic, seconds))


def reports_of(source: Source) -> Reports:
    """The attribute `reports` of a source; empty if it has none."""
    reports = getattr(source, "reports", None)
    return reports if isinstance(reports, Reports) else Reports()
