"""Which frames of a source are used, and what is done to them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Literal

from hsslam_node.errors import UserError
from hsslam_node.odometry.noise import USUAL_NOISE
from hsslam_node.sources.options.camera import CameraOptions, RealsenseOptions
from hsslam_node.sources.options.limits import expect_range
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.sources.options.topics import BagOptions, Ros2Options


@dataclass(frozen=True)
class RecordOptions:
    """Images of record:FOLDER."""

    rate_hz: float = 30.0
    """Frame rate if file names carry no time stamps, Hz."""
    max_dt_ms: float = 20.0
    """Largest time between a colour image and its depth image, ms."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.rate_hz) and 0 < self.rate_hz <= 1000):
            raise UserError(f"--record.rate-hz {self.rate_hz}: expected above 0, up to 1000")
        expect_range("record.max-dt-ms", self.max_dt_ms, 0, 1000)


@dataclass(frozen=True)
class SourceOptions:
    """Which frames of a source are used, and what is done to them."""

    noise: Literal["none", "kinect"] = "none"
    """Depth noise added to an exact source."""
    exposure: Literal["none", "drift"] = "none"
    """Gain and bias of the images that change as with automatic exposure."""
    seed: int = 0
    """Seed of noise and exposure."""
    start: int = 0
    """Leave out this many frames at the beginning."""
    stride: int = 1
    """Use every n-th of the other frames."""
    frames: int | None = None
    """Use at most this many frames."""
    to_and_fro: int = 1
    """Play the frames this many times, every second time backwards."""
    hold_at: int = 0
    """Number of the frame that is held."""
    hold_frames: int = 0
    """Repeat that frame this many times, like a camera that stands still."""
    cover_at: int = 0
    """Number of the first frame with a covered lens."""
    cover_frames: int = 0
    """Cover the lens for this many frames: black, and without depth."""
    base_T_camera: tuple[float, ...] = ()
    """Camera in base_link, the frame of odometry: x y z qx qy qz qw, m (none: looking ahead)."""
    odometry_noise: float = USUAL_NOISE
    """Standard deviation of odometry after 1 m (in m) and 1 rad (in rad)."""
    camera_T_imu: tuple[float, ...] = ()
    """IMU in the camera's optical frame: x y z qx qy qz qw, m (none: from /tf_static of ROS, else the IMU
    has the camera's centre and axes)."""
    mask: str = ""
    """Image file, or folder of images named like the colour images; black pixels get no depth (empty:
    none)."""
    downscale: int = 1
    """Make images smaller by this factor along each side."""
    synth: SynthOptions = field(default_factory=SynthOptions)
    camera: CameraOptions = field(default_factory=CameraOptions)
    record: RecordOptions = field(default_factory=RecordOptions)
    ros2: Ros2Options = field(default_factory=Ros2Options)
    bag: BagOptions = field(default_factory=BagOptions)
    realsense: RealsenseOptions = field(default_factory=RealsenseOptions)
    is_reopened: bool = False
    """A run opens its live camera again, which goes on without sensors that are silent; not an option."""

    def __post_init__(self) -> None:
        if self.noise not in ("none", "kinect"):
            raise UserError(f"--noise {self.noise!r}: expected none or kinect")
        if self.exposure not in ("none", "drift"):
            raise UserError(f"--exposure {self.exposure!r}: expected none or drift")
        expect_range("seed", self.seed, 0, 2**31 - 1)
        expect_range("start", self.start, 0, 1_000_000_000)
        expect_range("stride", self.stride, 1, 1_000_000)
        expect_range("to-and-fro", self.to_and_fro, 1, 10_000)
        expect_range("hold-at", self.hold_at, 0, 1_000_000_000)
        expect_range("hold-frames", self.hold_frames, 0, 10_000_000)
        expect_range("cover-at", self.cover_at, 0, 1_000_000_000)
        expect_range("cover-frames", self.cover_frames, 0, 10_000_000)
        expect_range("downscale", self.downscale, 1, 16)
        expect_range("odometry-noise", self.odometry_noise, 1e-4, 1.0)
        if self.frames is not None:
            expect_range("frames", self.frames, 1, 1_000_000_000)

    @classmethod
    def among(cls, options: object) -> "SourceOptions":
        """The options of a command that are options of a source: its fields of the same names."""
        given = [option.name for option in fields(SourceOptions) if hasattr(options, option.name)]
        return cls(**{name: getattr(options, name) for name in given})

    @property
    def reorders(self) -> bool:
        """Whether frames come more than once; then `Restamped` sets the stamps."""
        return self.to_and_fro > 1 or self.hold_frames > 0

    def recorded(self, count: int) -> range:
        """The frames that `--start` and `--stride` select of `count`, before all other options."""
        return range(self.start, count, self.stride)

    def selected(self, count: int) -> Sequence[int]:
        """Which of `count` frames are used, in this order; ground truth and source select alike."""
        chosen: Sequence[int] = self.recorded(count)
        if self.reorders:
            chosen = self._held(_to_and_fro(chosen, self.to_and_fro))
        return chosen if self.frames is None else chosen[: self.frames]

    def _held(self, chosen: list[int]) -> list[int]:
        held = chosen[self.hold_at : self.hold_at + 1] * self.hold_frames
        return [*chosen[: self.hold_at], *held, *chosen[self.hold_at :]]


def _to_and_fro(rows: Sequence[int], times: int) -> list[int]:
    """The rows forwards, backwards, forwards ...; rows at the turns come once."""
    order = list(rows)
    back, forth = order[-2::-1], order[1:]
    for turn in range(1, times):
        order += back if turn % 2 else forth
    return order
