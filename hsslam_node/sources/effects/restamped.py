"""Stamps of a source that is played more than once; alone, as ground truth uses them too."""

from collections.abc import Iterator
from dataclasses import replace

from hsslam_node.frame import Frame
from hsslam_node.sources.effects.changed_source import ChangedSource
from hsslam_node.sources.source import BadFrame, IsLate, LateFrame, Source


class Restamped(ChangedSource):
    """A source whose frames come more than once, stamped as by a camera that never stopped: n / rate."""

    def __init__(self, source: Source) -> None:
        super().__init__(source, "played again")

    def frames_in_time(self, first: int, is_late: IsLate) -> Iterator[Frame | BadFrame]:
        """As of any `ChangedSource`; frames are late by their new stamps."""

        def is_late_now(index: int, stamp_ns: int) -> bool:
            return is_late(index, running_stamp_ns(index, self.rate_hz))

        for item in super().frames_in_time(first, is_late_now):
            if isinstance(item, LateFrame):
                item = replace(item, stamp_ns=running_stamp_ns(item.index, self.rate_hz))
            yield item

    def changed(self, frame: Frame) -> Frame:
        """The frame at its time."""
        return replace(frame, stamp_ns=running_stamp_ns(frame.index, self.rate_hz))


def running_stamp_ns(index: int, rate_hz: float) -> int:
    """Stamp of frame `index` of a source that is played again, ns."""
    return round(index * 1e9 / rate_hz)
