"""What a user can ask of a source: a camera, the built-in scenes, which frames, what is done to them."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Literal

from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import LensModel, expect_lens
from hsslam_node.odometry.noise import USUAL_NOISE


@dataclass(frozen=True)
class CameraOptions:
    """Camera of record: and 7scenes:, before their camera.json; bag: and ros2: take depth_scale alone."""

    fx: float | None = None
    """Focal length along x, pixels."""
    fy: float | None = None
    """Focal length along y, pixels (none: same as fx)."""
    cx: float | None = None
    """Principal point from the centre of the first column, pixels (none: middle)."""
    cy: float | None = None
    """Principal point from the centre of the first row, pixels (none: middle)."""
    distortion: tuple[float, ...] = ()
    """Lens distortion in OpenCV's order: 4, 5, 8, 12 or 14 numbers (equidistant: 4)."""
    distortion_model: LensModel | None = None
    """Lens model of these numbers (none: opencv)."""
    depth_scale: float | None = None
    """Depth image units per metre, 1000 for millimetres."""

    def __post_init__(self) -> None:
        for name in ("fx", "fy", "depth_scale"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                option = name.replace("_", "-")
                raise UserError(f"--camera.{option} {value}: expected a number above 0")
        for name in ("cx", "cy"):
            value = getattr(self, name)
            if value is not None and not math.isfinite(value):
                raise UserError(f"--camera.{name} {value}: expected a finite number")
        if self.distortion:
            expect_lens("--camera.distortion", self.distortion, self.distortion_model or "opencv")

    def given(self) -> dict[str, object]:
        """The values that are set, or follow from those, named as in a camera.json."""
        numbers = ("fx", "fy", "cx", "cy", "depth_scale")
        fields: dict[str, object] = {name: getattr(self, name) for name in numbers}
        fields["distortion"] = list(self.distortion) or None
        fields["fy"] = self.fy or self.fx
        fields["distortion_model"] = self.distortion_model or (
            "opencv" if self.distortion else None
        )
        return {name: value for name, value in fields.items() if value is not None}


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
        _expect_max_dt("record", self.max_dt_ms)


@dataclass(frozen=True)
class Ros2Options:
    """Topics of ros2:/camera; a name without a leading / is below /camera."""

    color: str = "color/image_raw"
    """Colour images; a name ending in /compressed is JPEG or PNG."""
    depth: str = "aligned_depth_to_color/image_raw"
    """Depth images, registered to colour."""
    info: str = ""
    """Intrinsics (empty: camera_info beside the colour images)."""
    domain: int = 0
    """ROS_DOMAIN_ID of the ROS nodes."""
    connect: str = "tcp/127.0.0.1:7447"
    """Zenoh router of the ROS nodes, or of this service."""
    odometry: str = ""
    """Odometry of the robot, nav_msgs/Odometry, as /odom (empty: none)."""
    imu: str = ""
    """IMU of the camera, sensor_msgs/Imu, as /camera/imu (empty: none)."""
    max_dt_ms: float = 15.0
    """Largest time between a colour image and its depth image, ms."""
    timeout_s: float = 10.0
    """Longest wait for the first images, s."""

    def __post_init__(self) -> None:
        for name in ("color", "depth", "info", "odometry", "imu"):
            topic = getattr(self, name)
            if topic or name in ("color", "depth"):
                _expect_topic(f"--ros2.{name}", topic)
        if not 0 <= self.domain <= 232:
            raise UserError(f"--ros2.domain {self.domain}: expected 0 to 232")
        if not re.fullmatch(r"[a-z]+/\S+", self.connect):
            raise UserError(f"--ros2.connect {self.connect!r}: expected as tcp/127.0.0.1:7447")
        _expect_max_dt("ros2", self.max_dt_ms)
        if not 0 < self.timeout_s <= 3600:
            raise UserError(f"--ros2.timeout-s {self.timeout_s}: expected above 0, up to 3600")

    def topics_under(self, name: str) -> tuple[str, str, str]:
        """Topics of colour, depth and intrinsics of the camera of this name (`/camera`).

        Raises:
            UserError: no name of a ROS 2 namespace.
        """
        if not re.fullmatch(r"/|(/\w+)+", name):
            raise UserError(f"source ros2:{name}: expected the camera's namespace, as ros2:/camera")
        color, depth = (_below(name, topic) for topic in (self.color, self.depth))
        beside = f"{color.removesuffix('/compressed').rpartition('/')[0]}/camera_info"
        return color, depth, _below(name, self.info) if self.info else beside

    def topic_of_odometry(self, name: str) -> str:
        """The topic of odometry of the camera of this name; empty if there is none."""
        return _below(name, self.odometry) if self.odometry else ""

    def topic_of_imu(self, name: str) -> str:
        """The topic of the IMU of the camera of this name; empty if there is none."""
        return _below(name, self.imu) if self.imu else ""


@dataclass(frozen=True)
class BagOptions:
    """Topics of bag:FOLDER and bag:FILE; without them the bag must have one of each."""

    color: str = ""
    """Colour images (empty: the only topic with some)."""
    depth: str = ""
    """Depth images, registered to colour (empty: the only topic with some)."""
    info: str = ""
    """Intrinsics (empty: camera_info beside the colour images)."""
    odometry: str = ""
    """Odometry of the robot, nav_msgs/Odometry (empty: none is used)."""
    imu: str = ""
    """IMU, sensor_msgs/Imu (empty: with --camera-T-imu the only topic with some, else none is used)."""
    max_dt_ms: float = 15.0
    """Largest time between a colour image and its depth image, ms."""

    def __post_init__(self) -> None:
        for name in ("color", "depth", "info", "odometry", "imu"):
            topic = getattr(self, name)
            if topic:
                _expect_topic(f"--bag.{name}", topic)
        _expect_max_dt("bag", self.max_dt_ms)


def _expect_topic(option: str, topic: str) -> None:
    if not re.fullmatch(r"/?\w+(/\w+)*", topic):
        raise UserError(f"{option} {topic!r}: expected the name of a topic")


def _expect_max_dt(source: str, max_dt_ms: float) -> None:
    if not 0 <= max_dt_ms <= 1000:
        raise UserError(f"--{source}.max-dt-ms {max_dt_ms}: expected 0 to 1000")


def _below(name: str, topic: str) -> str:
    return topic if topic.startswith("/") else f"{name.rstrip('/')}/{topic}"


@dataclass(frozen=True)
class RealsenseOptions:
    """Camera of source realsense."""

    serial: str = ""
    """Serial number (empty: the first camera found)."""
    width_px: int = 640
    """Image width, pixels."""
    height_px: int = 480
    """Image height, pixels."""
    rate_hz: int = 30
    """Frame rate, Hz."""

    def __post_init__(self) -> None:
        for name, low, high in (
            ("width_px", 160, 1920),
            ("height_px", 120, 1440),
            ("rate_hz", 1, 90),
        ):
            if not low <= getattr(self, name) <= high:
                option = name.replace("_", "-")
                raise UserError(
                    f"--realsense.{option} {getattr(self, name)}: expected {low} to {high}"
                )


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
    odometry_noise: float | None = None
    """Simulated odometry with this error, as a share of each motion (none: frames carry no odometry)."""
    imu_noise: float | None = None
    """Simulated IMU with this multiple of the errors of a cheap one (none: frames carry no IMU)."""

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
        if self.odometry_noise is not None:
            _expect_range("synth.odometry-noise", self.odometry_noise, 0.0, 1.0)
        if self.imu_noise is not None:
            _expect_range("synth.imu-noise", self.imu_noise, 0.0, 100.0)


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
    """Leave out this many frames at the beginning."""
    stride: int = 1
    """Use every n-th frame of the others."""
    frames: int | None = None
    """Use at most this many frames."""
    to_and_fro: int = 1
    """Play the frames this many times, every second time backwards."""
    hold_at: int = 0
    """Number of the frame that is held."""
    hold_frames: int = 0
    """Repeat that frame this many times, like a camera that stands still."""
    cover_at: int = 0
    """Number of the first frame of which the lens is covered."""
    cover_frames: int = 0
    """Cover the lens for this many frames: black, and without depth."""
    base_T_camera: tuple[float, ...] = ()
    """Camera in base_link, whose odometry it is: x y z qx qy qz qw, m (none: looking ahead)."""
    odometry_noise: float = USUAL_NOISE
    """Standard deviation of odometry after 1 m, m, and after 1 rad, rad."""
    camera_T_imu: tuple[float, ...] = ()
    """IMU in the camera's optical frame: x y z qx qy qz qw, m (none: as /tf_static of ROS has it, else in
    the camera's centre, with its axes)."""
    mask: str = ""
    """Image file, or folder of images named as those of colour; where it is black, frames have no depth
    (empty: none)."""
    downscale: int = 1
    """Make images smaller by this factor along each side."""
    synth: SynthOptions = field(default_factory=SynthOptions)
    camera: CameraOptions = field(default_factory=CameraOptions)
    record: RecordOptions = field(default_factory=RecordOptions)
    ros2: Ros2Options = field(default_factory=Ros2Options)
    bag: BagOptions = field(default_factory=BagOptions)
    realsense: RealsenseOptions = field(default_factory=RealsenseOptions)

    def __post_init__(self) -> None:
        if self.noise not in ("none", "kinect"):
            raise UserError(f"--noise {self.noise!r}: expected none or kinect")
        if self.exposure not in ("none", "drift"):
            raise UserError(f"--exposure {self.exposure!r}: expected none or drift")
        _expect_range("seed", self.seed, 0, 2**31 - 1)
        _expect_range("start", self.start, 0, 1_000_000_000)
        _expect_range("stride", self.stride, 1, 1_000_000)
        _expect_range("to-and-fro", self.to_and_fro, 1, 10_000)
        _expect_range("hold-at", self.hold_at, 0, 1_000_000_000)
        _expect_range("hold-frames", self.hold_frames, 0, 10_000_000)
        _expect_range("cover-at", self.cover_at, 0, 1_000_000_000)
        _expect_range("cover-frames", self.cover_frames, 0, 10_000_000)
        _expect_range("downscale", self.downscale, 1, 16)
        _expect_range("odometry-noise", self.odometry_noise, 1e-4, 1.0)
        if self.frames is not None:
            _expect_range("frames", self.frames, 1, 1_000_000_000)

    @classmethod
    def among(cls, options: object) -> "SourceOptions":
        """The options of a command that are options of a source: its fields of the same names."""
        given = [option.name for option in fields(SourceOptions) if hasattr(options, option.name)]
        return cls(**{name: getattr(options, name) for name in given})

    @property
    def reorders(self) -> bool:
        """Whether frames come more than once: stamps then run on, see `Restamped`."""
        return self.to_and_fro > 1 or self.hold_frames > 0

    def selected(self, count: int) -> Sequence[int]:
        """Which of `count` frames are used, in this order; ground truth and source select alike."""
        chosen: Sequence[int] = range(self.start, count, self.stride)
        if self.reorders:
            chosen = self._held(_to_and_fro(chosen, self.to_and_fro))
        return chosen if self.frames is None else chosen[: self.frames]

    def _held(self, chosen: list[int]) -> list[int]:
        held = chosen[self.hold_at : self.hold_at + 1] * self.hold_frames
        return [*chosen[: self.hold_at], *held, *chosen[self.hold_at :]]


def _to_and_fro(rows: Sequence[int], times: int) -> list[int]:
    """The rows forwards, backwards, forwards ...; those at the turns come once."""
    order = list(rows)
    back, forth = order[-2::-1], order[1:]
    for turn in range(1, times):
        order += back if turn % 2 else forth
    return order


def _expect_range(option: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:  # nan is not
        raise UserError(f"--{option} {value}: expected {low} to {high}")
