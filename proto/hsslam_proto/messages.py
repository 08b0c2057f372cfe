"""Messages of frames, poses and the map, as msgspec structs; `codec.py` encodes them as msgpack."""

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

    `stamp_ns` is the time of capture on the wall clock. `source_stamp_ns` is the time of capture on the
    source's own clock, ns since any moment. It grows from frame to frame: the tracker predicts motion by it,
    and trajectories list it. A recording sends the stamp in its files; a live driver sends `stamp_ns` again,
    or the stamp of the camera's clock.

    `color` is [H, W, 3] uint8 RGB raw ("rgb8"), a JPEG or a PNG; `depth` is [H, W] uint16 raw, little
    endian ("u16"), or a 16-bit PNG, in units of 1 / depth_units_per_m; 0 and 65535: no measurement. A pixel
    that undistortion cannot fill has the colour of the border, not black, and depth 0.

    `publisher` is a random number from `2**62` to `2**63 - 1`. A camera draws a new one each time it counts
    from 0, so publisher and index identify a frame. If it is 0, the publisher in the attachment takes its
    place, and a lower index with a later `stamp_ns` begins a new count. A frame whose `index` is more than
    `2**20` above the last is refused and counted as rejected; after ten such frames in a row, the service
    takes it that the camera counts on from there.

    `odometry`: pose of the camera at the stamp by wheel or other odometry, in a frame of its own that
    drifts: x, y, z, qx, qy, qz, qw. Empty: unknown. `odometry_covariance` lists the same 21 numbers as
    `covariance` of `Pose`, but along the axes of the odometry's own frame. It grows along the path: its
    growth between two frames is the covariance of the motion between them. Empty beside `odometry`: the
    standard deviations are 2 cm after 1 m and 0.02 rad after 1 rad. `odometry_series` is a random number
    from `0` to `2**63 - 1`, drawn anew each time odometry or its covariance restarts. If it or `publisher`
    changes, the motion since the frame before is unknown.

    `imu`: integral of the samples of an IMU from the start of a series to the stamp: rotation of the camera
    qx, qy, qz, qw, integral of its specific force vx, vy, vz (m/s; at rest it grows upwards), and duration
    (s). Axes: those of the camera (x right, y down, z forward) at the start of the series. `imu_series` names
    the series: its first stamp, or a later number if the clock was set back. Only differences between frames
    of one series are of use. Empty: unknown.

    `source_wait_ns`: how late a frame of a recording comes because its source waited, as for a slow disk, ns.
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
    source_wait_ns: Index = 0

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

    `stamp_ns` is the time of the measurement on the wall clock. `covariance` lists the same 21 numbers as
    `covariance` of `Pose`, but along the axes of the odometry's own frame. The tracker uses its growth from
    message to message, not its value. Empty: unknown. `--base-T-camera`: pose of the camera on the base.
    Nothing reads these messages in lockstep, nor with `zenoh:`, whose frames carry `odometry` themselves.
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

    `stamps_ns` are the times of the measurements on the wall clock, `angular_velocity` is in rad/s,
    `acceleration` in m/s^2 as an accelerometer measures it: at rest 9.81, upwards. Axes are those of the IMU:
    `--camera-T-imu` is its pose in the camera's optical frame. Nothing reads these messages in lockstep, nor
    with `zenoh:`, whose frames carry `imu` themselves.
    """

    stamps_ns: Stamps
    angular_velocity: Vectors
    acceleration: Vectors

    def __post_init__(self) -> None:
        counts = [len(self.stamps_ns), len(self.angular_velocity), len(self.acceleration)]
        if len(set(counts)) > 1:
            raise ValueError(
                f"{counts} stamps, angular velocities, accelerations: expected the same number of each"
            )


class Pose(Message, frozen=True, kw_only=True):
    """Camera-to-world pose of one frame, as first estimated (m; unit quaternion xyzw).

    `publisher`: number of the camera that sent the frame. A camera without one gets a new number after each
    restart.
    `map_version`, `pose_version`: versions of the map and of the keyframes' poses that the tracker aligned
    the frame to.
    `in_keyframe`: pose of the camera in the keyframe `keyframe`: x, y, z, qx, qy, qz, qw. When a correction
    moves the keyframe, also one of a saved map, the camera moves with it. Empty: no keyframe, or an old log.
    `map_epoch`, here and elsewhere: number of resets of the map so far. Each new map has a coordinate frame
    of its own, so poses of two map epochs cannot be compared.

    `covariance`: of x, y, z (m) and of rotations about the fixed axes x, y, z (rad) through the camera's
    centre, along the axes of the world; the upper triangle of the 6 x 6 matrix row by row, 21 numbers. It
    describes the error against the first frame's pose, or against a saved map: on the two sequences of its
    calibration, 95 % of the true errors lie inside its 95 % ellipsoid, on another sequence 50 %.
    Empty: unknown. `odometry`: x, y, z, qx, qy, qz, qw of the camera on a path without the jumps of
    corrections; it begins with the run and drifts, and goes on in a fragment. Empty: unknown.
    `odometry_stands`: the motion to this frame is unknown, as after a gap, when a fragment begins or when a
    lost camera is found; `odometry` then repeats the last pose. If the pose of the camera on the robot is
    known, height and tilt of `base_link` are then set to those in the map, unless a fragment begins.

    `up`: direction against gravity in the world, measured by an IMU. Empty: unknown.

    `is_dead_reckoned`: the tracker could not align the frame, and its pose comes from the odometry of `Frame`
    alone. Its `quality` is 0; `covariance` is the uncertainty of the pose.

    `fragment`: number of the fragment in which a camera that is lost to the map is tracked; 0: none. In a
    fragment, status is lost, and pose, keyframe and quality refer to the fragment, which has a coordinate
    frame of its own. When a fragment joins the map, its keyframes are published with its number.
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
    """A frame has become keyframe `id`; its pixels are in the arena. A `Correction` of it, which another
    process sends, may come before.

    `fragment`: number of the fragment that the keyframe came from; 0: none. `t_in_fragment`, `q_in_fragment`:
    its pose in that fragment. It replaces the fragment's keyframes from number `fragment_keyframe` up to
    that of the fragment's next keyframe in the map; -1: unknown.
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
    """New poses of keyframes from global BA or mapping, computed from `base_version` of the poses. A
    correction of more than 8192 keyframes comes in several messages of the same `pose_version`.

    A correction leaves out keyframes that have moved by at most 1 mm and 1 mrad since it last had them. When
    the number of keyframes has grown by half, the next correction has the poses of all. If there were
    corrections, a message with both versions equal has the poses of all keyframes at the end.

    `loops`: pairs of keyframes, the older one first, of new loop closures.
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
            raise ValueError("keyframes, t and q: expected lists of the same length")
        for t, q in zip(self.t, self.q, strict=True):
            expect_pose(t, q)


class View(Message, frozen=True, kw_only=True):
    """The map rendered at the pose of frame `index`: [H, W, 3] uint8 RGB, black where the map is empty."""

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
        raise ValueError(f"imu: quaternion of norm {norm:.4f}: expected a unit quaternion xyzw")
