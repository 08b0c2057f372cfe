"""What every camera looks like to the rest of the system, and the options that choose one."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.camera_options import CameraOptions
from hsslam_node.sources.realsense_options import RealsenseOptions
from hsslam_node.sources.record_options import RecordOptions
from hsslam_node.sources.ros2_options import Ros2Options


class Source(Protocol):
    """A sequence of RGB-D frames, without ground truth: that is `evaluation.open_ground_truth`."""

    name: str
    camera: Camera  # without distortion
    rate_hz: float
    frame_count: int | None  # None: not known in advance
    depth_units_per_m: float

    def frames(self) -> "Iterator[Frame | BadFrame]":
        """Frames in order of their stamps; what cannot be read comes as a `BadFrame`."""
        ...


@dataclass(frozen=True)
class BadFrame:
    """A frame that could not be read: counted and told, and the run goes on."""

    index: int
    stamp_ns: int
    reason: str


@dataclass(frozen=True)
class SynthOptions:
    """Built-in scenes, synth:room and others."""

    size_m: tuple[float, float, float] = (5.6, 4.6, 2.6)
    """Length, width and height of synth:room, m; other scenes have fixed sizes."""
    length: int | None = None
    """Number of frames (none: that of the scene, 600 for synth:room)."""
    seed: int = 0
    """Seed of colours, pictures and hand-held motion."""
    width_px: int = 640
    """Image width, pixels."""
    height_px: int = 480
    """Image height, pixels."""
    rate_hz: float = 30.0
    """Frame rate, Hz."""

    def __post_init__(self) -> None:
        limits = ((4.0, 16.0), (4.0, 16.0), (2.4, 4.0))
        for value, (low, high) in zip(self.size_m, limits, strict=True):
            if not low <= value <= high:
                raise UserError(
                    f"--synth.size-m {self.size_m}: expected 4 to 16, 4 to 16 and 2.4 to 4 m"
                )
        if self.length is not None:
            _expect_range("synth.length", self.length, 2, 1_000_000)
        _expect_range("synth.seed", self.seed, 0, 2**31 - 1)
        _expect_range("synth.width-px", self.width_px, 32, 1920)
        _expect_range("synth.height-px", self.height_px, 32, 1440)
        _expect_range("synth.rate-hz", self.rate_hz, 1.0, 240.0)


@dataclass(frozen=True)
class SourceOptions:
    """Which frames of a source are used, and what is done to them."""

    noise: Literal["none", "kinect"] = "none"
    """Depth noise added to an exact source."""
    exposure: Literal["none", "drift"] = "none"
    """Gain and bias added to the images, as of a camera that sets its own exposure."""
    seed: int = 0
    """Seed of noise and exposure."""
    start: int = 0
    """Leave out so many frames at the beginning."""
    stride: int = 1
    """Use every n-th frame of the others."""
    frames: int | None = None
    """Use at most this many frames."""
    downscale: int = 1
    """Make images so many times smaller along each side."""
    synth: SynthOptions = field(default_factory=SynthOptions)
    camera: CameraOptions = field(default_factory=CameraOptions)
    record: RecordOptions = field(default_factory=RecordOptions)
    ros2: Ros2Options = field(default_factory=Ros2Options)
    realsense: RealsenseOptions = field(default_factory=RealsenseOptions)

    def __post_init__(self) -> None:
        if self.noise not in ("none", "kinect"):
            raise UserError(f"--noise {self.noise!r}: expected none or kinect")
        if self.exposure not in ("none", "drift"):
            raise UserError(f"--exposure {self.exposure!r}: expected none or drift")
        _expect_range("seed", self.seed, 0, 2**31 - 1)
        _expect_range("start", self.start, 0, 1_000_000_000)
        _expect_range("stride", self.stride, 1, 1_000_000)
        _expect_range("downscale", self.downscale, 1, 16)
        if self.frames is not None:
            _expect_range("frames", self.frames, 1, 1_000_000_000)

    def selected(self, count: int) -> Sequence[int]:
        """Which of `count` frames are used; ground truth and source select alike."""
        chosen = range(self.start, count, self.stride)
        return chosen if self.frames is None else chosen[: self.frames]


def _expect_range(option: str, value: float, low: float, high: float) -> None:
    if not (np.isfinite(value) and low <= value <= high):
        raise UserError(f"--{option} {value}: expected {low} to {high}")
