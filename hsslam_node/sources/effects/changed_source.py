"""A source that changes the frames of another; the base of all effects."""

from abc import abstractmethod
from collections.abc import Iterator

from hsslam_node.frame import Frame
from hsslam_node.sources.reports import reports_of
from hsslam_node.sources.source import (
    BadFrame,
    IsLate,
    ReadsInTime,
    Source,
    frames_in_time,
    of_one_camera,
)


class ChangedSource(ReadsInTime):
    """The frames of another source, each put through `changed`; an unreadable one stays a `BadFrame`.

    A frame of another camera than the source's becomes one, too.
    `suffix` is added to the name of the other source.
    """

    def __init__(self, source: Source, suffix: str) -> None:
        self._source = source
        self.name = f"{source.name} {suffix}"
        self.camera = source.camera
        self.rate_hz = source.rate_hz
        self.frame_count = source.frame_count
        self.depth_units_per_m = source.depth_units_per_m
        self.reports = reports_of(source)

    def frames_in_time(self, first: int, is_late: IsLate) -> Iterator[Frame | BadFrame]:
        """The frames of the other source, changed; late ones are skipped if it can do that."""
        for item in frames_in_time(self._source, first, is_late):
            frame = item if isinstance(item, BadFrame) else of_one_camera(self._source, item)
            yield frame if isinstance(frame, BadFrame) else self.changed(frame)

    @abstractmethod
    def changed(self, frame: Frame) -> Frame:
        """The frame after the change."""
