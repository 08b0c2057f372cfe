"""The messages of frames, poses and the map, as msgspec structs; encoded as msgpack by `codec.py`."""

# ruff: noqa: RUF012 - msgspec copies a default that is an empty list or map

import math
from typing import Annotated, Literal

from msgspec import Meta

from hsslam_proto.message import (
    Covariance,
    Direction,
    FrameIndex,
    Index,
    Inertial,
    Message,
    PoseNumbers,
    Quaternion,
    Ratio,
    Real,
    SizePx,
    StageTimes,
    StampNs,
    Stamps,
    Vector,
    Vectors,
    expect_bytes,
    expect_count,
    expect_finite,
    expect_pose,
    expect_pose_numbers,
)


class Frame(Message, frozen=True, kw_only=True):
    """One undistorted RGB-D frame; depth is registered to colour; pixel centres at integers.

    `stamp_ns` is the wall clock of the sensor. `source_stamp_ns` is the time of capture on the source's own
    clock, ns since any moment. It grows from frame to frame: motion is predicted by it, and trajectories have
    it. A recording sends the stamp in its files, a live driver that of `stamp_ns` or of the camera's clock.

    `color` is [H, W, 3] uint8 RGB raw ("rgb8"), a JPEG or a PNG; `depth` is [H, W] uint16 raw, little
    endian ("u16"), or a 16-bit PNG, in units of 1 / depth_units_per_m, 0 = no measurement. Where undistortion
    finds no pixel, color is that of the border, not black, and depth is 0.

    `publisher` is a random number from 2**62 on that a camera draws each time it counts from 0, so that its
    frames are known by publisher and index. Without one (0) the publisher in the attachment stands for it,
    and a lower index with a later `stamp_ns` begins a new count.

    `odometry`: pose of the camera at the stamp by wheel or other odometry, in a frame of its own that
    drifts: x, y, z, qx, qy, qz, qw. Empty: not known. `odometry_covariance` lists the same 21 numbers as
    `covariance` of `Pose`, but along the axes of the odometry's own frame. It grows along the path: its
    growth between two frames is the covariance of the motion between them. Empty with `odometry`: 2 cm
    after 1 m and 0.02 rad after 1 rad, standard deviations. `odometry_series` is another random number each
    time that odometry or its covariance begins anew. If it changes, or the camera does (`publisher`), the
    motion since the frame before is unknown.

    `imu`: what an IMU has integrated up to the stamp, in the camera's axes (x right, y down, z forward) and
    those that it had when the series began: qx, qy, qz, qw of the camera, the integral of its specific force
    vx, vy, vz (m/s; at rest it grows upwards), and the time since then (s). `imu_series` names the series:
    its first stamp, or a later number if the clock was set back. Only differences between frames of one
    series count. Empty: not known.
    """

    index: FrameIndex
    stamp_ns: StampNs
    source_stamp_ns: StampNs
    width_px: SizePx
    height_px: SizePx
    fx: Real
    fy: Real
    cx: Real
    cy: Real
    color: memoryview
    color_encoding: Literal["rgb8", "jpeg", "png"] = "rgb8"
    depth: memoryview
    depth_encoding: Literal["u16", "png"] = "u16"
    depth_units_per_m: Real
    publisher: Index = 0
    odometry: PoseNumbers = []
    odometry_covariance: Covariance = []
    odometry_series: Index = 0
    imu: Inertial = []
    imu_series: StampNs = 0

    def __post_init__(self) -> None:
        expect_pose_numbers(self, "odometry")
        expect_count(self, "odometry_covariance", 21)
        _expect_inertial(self)
        expect_finite(self, "fx", "fy", "cx", "cy", "depth_units_per_m")
        for name in ("fx", "fy", "depth_units_per_m"):
            if getattr(self, name) <= 0:
                raise ValueError(f"{name} = {getattr(self, name)}: expected > 0")
        pixels = self.width_px * self.height_px
        for name, raw, nbytes in (("color", "rgb8", 3 * pixels), ("depth", "u16", 2 * pixels)):
            size = memoryview(getattr(self, name)).nbytes
            if getattr(self, f"{name}_encoding") == raw and size != nbytes:
                raise ValueError(f"{name} has {size} bytes: expected {nbytes} for {raw}")


class RobotOdometry(Message, frozen=True, kw_only=True):
    """Pose of the robot's base (x forward, y left, z up) by wheel or other odometry, in a frame of its own
    that drifts (m; unit quaternion xyzw).

    `stamp_ns` is the wall clock of the measurement. `covariance` lists the same 21 numbers as that of `Pose`,
    but along the axes of the odometry's own frame. The tracker uses how much it grows from message to
    message, not its value. Empty: not known. `--base-T-camera` is the pose of the camera on the base.
    """

    stamp_ns: StampNs
    t: Vector
    q: Quaternion
    covariance: Covariance = []

    def __post_init__(self) -> None:
        expect_pose(self.t, self.q)
        expect_count(self, "covariance", 21)


class ImuSamples(Message, frozen=True, kw_only=True):
    """Samples of an IMU, one or more, in the order of their stamps.

    `stamps_ns` are the wall clock of the measurements, `angular_velocity` rad/s, `acceleration` m/s^2 as
    accelerometers have it: at rest 9.81, upwards. Axes are those of the IMU: `--camera-T-imu` is its pose in
    the camera's optical frame.
    """

    stamps_ns: Stamps
    angular_velocity: Vectors
    acceleration: Vectors

    def __post_init__(self) -> None:
        counts = [len(self.stamps_ns), len(self.angular_velocity), len(self.acceleration)]
        if len(set(counts)) > 1:
            raise ValueError(
                f"{counts} stamps, angular velocities, accelerations: expected as many of each"
            )


class Pose(Message, frozen=True, kw_only=True):
    """Camera-to-world pose of one frame, as known at the time (m; unit quaternion xyzw).

    `publisher`: number of the camera that sent the frame. A camera that sets none has a new one after each
    restart.
    `map_version`, `pose_version`: of the map and of the keyframes' poses that the frame was aligned to.
    `in_keyframe`: x, y, z, qx, qy, qz, qw of the camera in the keyframe `keyframe`, with which it moves when
    that is corrected, also one of a saved map. Empty: no keyframe, or not told, as in older logs.
    `map_epoch`, here and elsewhere: how often the map was thrown away. Each new map has a coordinate frame
    of its own, so poses of two map epochs cannot be compared.

    `covariance`: of x, y, z (m) and of rotations about the fixed axes x, y, z (rad), all axes those of the
    world, the rotation about the camera's centre; the upper triangle of the 6 x 6 matrix row by row, 21
    numbers. It is of the error against the first frame's pose, or against a saved map: on the two sequences
    that it was calibrated on, 95 % of the true errors lie inside its 95 % ellipsoid, on another one 52 %.
    Empty: not known. `odometry`: x, y, z, qx, qy, qz, qw of the camera on a path without
    the jumps of corrections; it begins with the run and drifts. Empty: not known. `odometry_stands`: the
    motion to this frame is not known, as after a gap or where a lost camera is found; `odometry` tells none.
    Height and tilt of `base_link` on that path become those in the map there, if the robot is known.

    `up`: direction against gravity in the world, as an IMU tells it. Empty: not known.

    `is_dead_reckoned`: the frame could not be aligned, and its pose is by the odometry of `Frame` alone. Its
    `quality` is 0; `covariance` says how sure the pose is.

    `fragment`: 0, or the number of the fragment that a camera which is lost to the map is tracked in; status
    is then lost, and pose, keyframe and quality are those in the fragment, which has a coordinate frame of
    its own. Keyframes of a fragment that joins the map are published then, with its number.
    """

    index: FrameIndex
    stamp_ns: StampNs
    source_stamp_ns: StampNs
    publish_ns: StampNs
    status: Literal["initial", "tracked", "lost"]
    t: Vector
    q: Quaternion
    quality: Ratio
    inlier_ratio: Ratio
    residual_mm: Real
    map_version: Index
    keyframe: Annotated[int, Meta(ge=-1, le=2**63 - 1)]
    stage_ms: StageTimes = {}
    map_epoch: Index = 0
    publisher: Index = 0
    pose_version: Index = 0
    covariance: Covariance = []
    odometry: PoseNumbers = []
    odometry_stands: bool = False
    up: Direction = []
    is_dead_reckoned: bool = False
    fragment: Index = 0
    in_keyframe: PoseNumbers = []

    def __post_init__(self) -> None:
        expect_pose(self.t, self.q)
        expect_count(self, "covariance", 21)
        expect_count(self, "up", 3)
        expect_pose_numbers(self, "odometry")
        expect_pose_numbers(self, "in_keyframe")


class Keyframe(Message, frozen=True, kw_only=True):
    """A frame has become keyframe `id`; its pixels are in the arena.

    `fragment`: number of the fragment that the keyframe came from; 0: none. `t_in_fragment`, `q_in_fragment`:
    its pose in that fragment. It takes the place of the fragment's keyframes from number `fragment_keyframe`
    on, up to that of the next such message; -1: the number is not known.
    """

    id: Index
    frame_index: FrameIndex
    source_stamp_ns: StampNs
    t: Vector
    q: Quaternion
    map_epoch: Index = 0
    fragment: Index = 0
    fragment_keyframe: Annotated[int, Meta(ge=-1, le=2**63 - 1)] = -1
    t_in_fragment: Vector = (0.0, 0.0, 0.0)
    q_in_fragment: Quaternion = (0.0, 0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        expect_pose(self.t, self.q)
        expect_pose(self.t_in_fragment, self.q_in_fragment)


class MapVersion(Message, frozen=True, kw_only=True):
    """The mapper has published version `version` of the parameters in the arena."""

    version: Index
    iterations: Index
    loss: Real
    keyframes: Index
    mapping_ms: Real
    map_epoch: Index = 0


class Correction(Message, frozen=True, kw_only=True):
    """New poses of keyframes from global BA or mapping, valid on top of `base_version` of the poses. One that
    moves more than 8192 keyframes comes in several messages of the same `pose_version`.

    `loops`: pairs of keyframes, the older one first, that were newly seen to show the same place.
    """

    pose_version: Index
    base_version: Index
    keyframes: list[Index]
    t: list[Vector]
    q: list[Quaternion]
    loss_before: Real
    loss_after: Real
    loops: list[tuple[Index, Index]] = []
    map_epoch: Index = 0

    def __post_init__(self) -> None:
        if not len(self.keyframes) == len(self.t) == len(self.q):
            raise ValueError("keyframes, t and q: expected one of each per keyframe")
        for t, q in zip(self.t, self.q, strict=True):
            expect_pose(t, q)


class View(Message, frozen=True, kw_only=True):
    """The map as seen from the pose of frame `index`: [H, W, 3] uint8 RGB, black where it has nothing."""

    index: Index
    stamp_ns: StampNs
    width_px: SizePx
    height_px: SizePx
    color: memoryview
    map_epoch: Index = 0

    def __post_init__(self) -> None:
        expect_bytes(self, "color", 3 * self.width_px * self.height_px)


def _expect_inertial(frame: Frame) -> None:
    expect_count(frame, "imu", 8)
    norm = math.hypot(*frame.imu[:4])
    if frame.imu and abs(norm - 1) > 1e-3:
        raise ValueError(
            f"imu has a quaternion of norm {norm:.4f}: expected a unit quaternion xyzw"
        )
