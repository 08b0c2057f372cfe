"""What every source looks like to the rest of the system; alone, as all sources import it."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera


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


class SourceLostError(Exception):
    """A live camera that gave frames is gone, perhaps for a while; the text is one line."""


@dataclass(frozen=True)
class BadFrame:
    """A frame that could not be read: counted and told, and the run goes on."""

    index: int
    stamp_ns: int
    reason: str
