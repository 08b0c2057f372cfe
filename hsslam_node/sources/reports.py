"""Faults of a source beside its frames; each kind is reported once, and counted."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from hsslam_node.sensor_watch import SensorWatch
from hsslam_node.sources.source import Source

USUAL_SHARE = 0.9  # of the images that have a counterpart; a source reports a smaller one
_MOST_WAITING = 1000


@dataclass(frozen=True)
class Report:
    """One fault; `kind`: the name that it is counted by, in a few words."""

    kind: str
    text: str

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


class ReportedSensor(SensorWatch):
    """Reports faults of the messages of a topic."""

    def __init__(self, topic: str, tell: Callable[[Report], None]) -> None:
        super().__init__()
        self._topic = topic
        self._tell = tell

    def clock_set_back(self, seconds: float) -> None:
        self._report("clock set back", f" by {seconds:.1f} s: motion is measured from the new time")

    def not_near(self, frames: int, ahead_s: float) -> None:
        where = f"{abs(ahead_s):.2f} s {'after' if ahead_s > 0 else 'before'} the frame"
        self._report(
            "no message near the frames",
            f": {frames} frames in a row, the newest message is {where}; expected stamps of the same clock",
        )

    def jumps(self, count: int, motions: int) -> None:
        self._report(
            "too fast for a robot",
            f": {count} of {motions} motions count as jumps; expected metres and radians",
        )

    def _report(self, fault: str, text: str) -> None:
        kind = f"{self._topic}: {fault}"
        self._tell(Report(kind, kind + text))


def reports_of(source: Source) -> Reports:
    """The attribute `reports` of a source; empty if it has none."""
    reports = getattr(source, "reports", None)
    return reports if isinstance(reports, Reports) else Reports()
