"""What goes wrong beside the frames of a source: told once a kind, and counted."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from hsslam_node.sources.source import Source

_MOST_WAITING = 1000


@dataclass(frozen=True)
class Report:
    """One thing that went wrong; `kind`: what it is counted as, in a few words."""

    kind: str
    text: str

    @classmethod
    def clock_set_back(cls, topic: str, seconds: float) -> "Report":
        """Stamps of a sensor's messages went back, by more than one that was overtaken."""
        kind = f"{topic}: clock set back"
        return cls(kind, f"{kind} by {seconds:.1f} s: motions are measured from there on")

    @classmethod
    def unusable(cls, topic: str, error: Exception) -> "Report":
        """A message of a sensor cannot be used; frames go on without it."""
        return cls(f"{topic}: unusable messages", f"{topic}: {error}; the message is left out")


class Reports:
    """What a source has to tell, until it is taken; of too many the newest stay."""

    def __init__(self) -> None:
        self._waiting: deque[Report] = deque(maxlen=_MOST_WAITING)

    def add(self, report: Report) -> None:
        """Tell it to the one who takes the next frame."""
        self._waiting.append(report)

    def take(self) -> list[Report]:
        """All that was told since the last time."""
        return [self._waiting.popleft() for _ in range(len(self._waiting))]


def clock_watch(topic: str, tell: Callable[[Report], None]) -> Callable[[float], None]:
    """What a track calls with the seconds by which stamps of this topic went back; `tell` gets a report."""
    return lambda seconds: tell(Report.clock_set_back(topic, seconds))


def reports_of(source: Source) -> Reports:
    """The attribute `reports` of a source; most have none, and nothing to tell."""
    reports = getattr(source, "reports", None)
    return reports if isinstance(reports, Reports) else Reports()
