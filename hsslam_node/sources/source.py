"""What every source looks like to the rest of the system; alone, as all sources import it."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera, camera_difference


class Source(Protocol):
    """A sequence of RGB-D frames, without ground truth: that is `evaluation.open_ground_truth`."""

    name: str
    camera: Camera  # without distortion
    rate_hz: float
    frame_count: int | None  # None: not known in advance
    depth_units_per_m: float

    def frames(self, first: int = 0) -> "Iterator[Frame | BadFrame]":
        """Frames in order of their stamps; what cannot be read comes as a `BadFrame`.

        `first`: how many are left out, without being decoded; a live camera takes no notice.
        """
        ...


IsLate = Callable[[int, int], bool]  # of index and stamp (ns): is the next frame due, too?


def never_late(index: int, stamp_ns: int) -> bool:
    """All frames are wanted, however long they take."""
    return False


class ReadsInTime(ABC):
    """A recording that leaves out frames before it decodes them, if it is slower than the sensor was."""

    reads_masks = False
    """Whether it applies masks of frames, from the folder that `--mask` names."""

    def frames(self, first: int = 0) -> "Iterator[Frame | BadFrame]":
        """Every frame from `first` on, as of `Source`."""
        return self.frames_in_time(first, never_late)

    @abstractmethod
    def frames_in_time(self, first: int, is_late: IsLate) -> "Iterator[Frame | BadFrame]":
        """As `frames`, with a `LateFrame` for each frame that is late when its turn comes."""


class SourceLostError(Exception):
    """A live camera that gave frames is gone, perhaps for a while; the text is one line."""


@dataclass(frozen=True)
class BadFrame:
    """A frame that could not be read: counted and told, and the run goes on."""

    index: int
    stamp_ns: int
    reason: str


@dataclass(frozen=True)
class LateFrame(BadFrame):
    """A frame that was not read, since it was late: counted, and the run goes on."""

    reason: str = "late"


def frames_in_time(source: Source, first: int, is_late: IsLate) -> Iterator[Frame | BadFrame]:
    """The frames of any source from `first` on; late ones are left out if the source can do that."""
    if isinstance(source, ReadsInTime):
        return source.frames_in_time(first, is_late)
    return source.frames(first)


def of_one_camera(source: Source, frame: Frame) -> Frame | BadFrame:
    """The frame; a `BadFrame` if its camera or depth scale is not the source's, as a log may have."""
    if difference := camera_difference(frame, source):
        reason = f"{difference} as in the first frame"
        return BadFrame(frame.index, frame.stamp_ns, reason)
    return frame
