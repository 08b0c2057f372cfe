"""A source whose every frame is changed: what noise, exposure and size have in common."""

from abc import ABC, abstractmethod
from collections.abc import Iterator

from hsslam_node.frame import Frame
from hsslam_node.sources.source import BadFrame, Source


class ChangedSource(ABC):
    """The frames of another source, each put through `changed`; what cannot be read stays a `BadFrame`.

    `suffix` is added to the name of the other source.
    """

    def __init__(self, source: Source, suffix: str) -> None:
        self._source = source
        self.name = f"{source.name} {suffix}"
        self.camera = source.camera
        self.rate_hz = source.rate_hz
        self.frame_count = source.frame_count
        self.depth_units_per_m = source.depth_units_per_m

    def frames(self) -> Iterator[Frame | BadFrame]:
        """The frames of the other source, changed."""
        for frame in self._source.frames():
            yield frame if isinstance(frame, BadFrame) else self.changed(frame)

    @abstractmethod
    def changed(self, frame: Frame) -> Frame:
        """This frame as the source delivers it."""
