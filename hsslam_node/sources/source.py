"""The interface of all sources."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera, camera_difference


class Source(Protocol):
    """A sequence of RGB-D frames; `evaluation.open_ground_truth` has the ground truth."""

    name: str
    camera: Camera  # without distortion
    rate_hz: float
    frame_count: int | None  # None: not known in advance
    depth_units_per_m: float

    def frames(self, first: int = 0) -> "Iterator[Frame | BadFrame]":
        """Frames in order of their stamps; an unreadable one comes as a `BadFrame`.

        `first`: number of frames to skip without decoding them; live cameras ignore it.
        """
        ...


IsLate = Callable[[int, int], bool]  # index, stamp (ns): is the next frame due, too?


def never_late(index: int, stamp_ns: int) -> bool:
    """No frame is late: the source reads all."""
    return False


class ReadsInTime(ABC):
    """A recording that can skip late frames before it decodes them."""

    reads_masks = False
    """Whether it applies masks of frames, from the folder that `--mask` names."""

    def frames(self, first: int = 0) -> "Iterator[Frame | BadFrame]":
        """Every frame from `first` on, as of `Source`."""
        return self.frames_in_time(first, never_late)

    @abstractmethod
    def frames_in_time(self, first: int, is_late: IsLate) -> "Iterator[Frame | BadFrame]":
        """As `frames`, with a `LateFrame` for each frame that is late when its turn comes."""


class SourceLostError(Exception):
    """A source that gave frames is gone, perhaps for a while; the text is one line."""


@dataclass(frozen=True)
class BadFrame:
    """An unreadable frame: the run counts and reports it, and goes on."""

    index: int
    stamp_ns: int
    reason: str


@dataclass(frozen=True)
class UnreadFrame(BadFrame):
    """A frame that a failing disk or its network did not give: the run counts it also by itself."""


@dataclass(frozen=True)
class LateFrame(BadFrame):
    """A frame that was skipped as late: the run counts it, and goes on."""

    reason: str = "late"


@dataclass(frozen=True)
class NoFrame(BadFrame):
    """A live camera has sent no frame for seconds: the run reports it; `--frames` does not count it."""


def frames_in_time(source: Source, first: int, is_late: IsLate) -> Iterator[Frame | BadFrame]:
    """The frames of any source from `first` on; late ones are skipped if the source can do that."""
    if isinstance(source, ReadsInTime):
        return source.frames_in_time(first, is_late)
    return source.frames(first)


def of_one_camera(source: Source, frame: Frame) -> Frame | BadFrame:
    """The frame, or a `BadFrame` if its camera or depth scale is not the source's, as in some logs."""
    if difference := camera_difference(frame, source):
        reason = f"{difference} as in the first frame"
        return BadFrame(frame.index, frame.stamp_ns, reason)
    return frame
