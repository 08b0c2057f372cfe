"""Faults of a source beside its frames; each kind is reported once, and counted."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from hsslam_node.sensor_watch import SensorWatch
from hsslam_node.sources.source import Source

_APART_NS = 10_000_000
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

    @classmethod
    def late_images(cls, topics: str, count: int) -> "Report":
        """Images came after a pair of newer ones; frames go on without them."""
        text = f"{topics}: {count} images came after newer pairs of colour and depth; they are left out"
        return cls("images out of order", text)

    @classmethod
    def of_pair(cls, topic: str, color_ns: int, depth_ns: int) -> "Report | None":
        """Colour and depth of a frame are more than 10 ms apart, which is used all the same."""
        apart_ns = abs(color_ns - depth_ns)
        if apart_ns <= _APART_NS:
            return None
        text = (
            f"{topic}: {1e-6 * apart_ns:.0f} ms between colour and depth of a frame, which blurs the map of "
            "a fast camera; expected at most 10 ms: let the camera take both at the same time"
        )
        return cls("colour and depth far apart", text)


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


def sensor_watch(topic: str, tell: Callable[[Report], None]) -> SensorWatch:
    """A watch of the messages of a topic; `tell` gets a report of each fault."""

    def report(fault: str, rest: str) -> None:
        kind = f"{topic}: {fault}"
        tell(Report(kind, kind + rest))

    return SensorWatch(report)


def reports_of(source: Source) -> Reports:
    """The attribute `reports` of a source; empty if it has none."""
    reports = getattr(source, "reports", None)
    return reports if isinstance(reports, Reports) else Reports()
