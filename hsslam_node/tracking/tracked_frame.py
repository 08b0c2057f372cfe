"""Depth points of a frame, its tracking result, and the predicted pose of the next frame."""

import math
from dataclasses import dataclass, replace

import numpy as np

from hsslam_node.config import TrackerConfig
from hsslam_node.depth_noise import averaging_limit
from hsslam_node.frame import Frame
from hsslam_node.geometry.fragment_place import FragmentPlace
from hsslam_node.geometry.se3 import inverse, se3_exp, se3_log
from hsslam_node.kernels.tracking.depth_points import sample_points
from hsslam_node.map.pose_log import STATUS, Status, pose_row
from hsslam_node.map.store import KeyframeStore

LONGEST_EXTRAPOLATION = 4.0  # times the last motion


@dataclass(frozen=True)
class TrackedFrame:
    """A frame that was tracked, placed relative to a keyframe, so that it follows corrections."""

    frame: Frame
    keyframe: int
    T_keyframe_cam: np.ndarray  # [4, 4]

    def pose(self, store: KeyframeStore) -> np.ndarray:
        """T_world_cam [4, 4] by the current pose of the keyframe."""
        return store.pose(self.keyframe) @ self.T_keyframe_cam


def predicted_pose(
    last: TrackedFrame,
    before: TrackedFrame | None,
    store: KeyframeStore,
    stamp_ns: int,
    longest: float = LONGEST_EXTRAPOLATION,
) -> np.ndarray:
    """T_world_cam [4, 4] at stamp_ns by constant SE(3) velocity; the last pose if `before` is None.

    longest: the last motion is extrapolated to at most this many times its own length.
    """
    T_last = last.pose(store)
    if before is None:
        return T_last
    share = np.clip(_reach(last, before, stamp_ns), 0.0, longest)
    return T_last @ se3_exp(share * se3_log(inverse(before.pose(store)) @ T_last))


def is_foreseen(last: TrackedFrame, before: TrackedFrame | None, stamp_ns: int) -> bool:
    """Whether the last motion predicts the pose at stamp_ns; False after a gap."""
    return before is not None and _reach(last, before, stamp_ns) <= LONGEST_EXTRAPOLATION


def _reach(last: TrackedFrame, before: TrackedFrame, stamp_ns: int) -> float:
    """Time from the last frame to stamp_ns over the time between the last two; 0 if the latter is 0."""
    past_ns = last.frame.stamp_ns - before.frame.stamp_ns
    return (stamp_ns - last.frame.stamp_ns) / past_ns if past_ns > 0 else 0.0


def orthonormal(T: np.ndarray) -> np.ndarray:
    """T [4, 4] with rounding errors of many products removed from its rotation."""
    U, _, Vt = np.linalg.svd(T[:3, :3])
    out = T.copy()
    out[:3, :3] = U @ Vt
    return out


@dataclass(frozen=True)
class JoinedFragment:
    """The n keyframes of a fragment after it joined the map; each moves with a keyframe of the map."""

    fragment: int
    place: FragmentPlace
    keyframes: np.ndarray  # [n] int64, id of the keyframe of the map that each moves with
    T_keyframe_own: np.ndarray  # [n, 4, 4], from each to the one that it moves with
    T_fragment_keyframe: np.ndarray  # [n, 4, 4], in the fragment, of the same keyframes

    def placed(self, frame: TrackedFrame) -> TrackedFrame:
        """A frame of the fragment, relative to a keyframe of the map."""
        k = frame.keyframe
        T_keyframe_cam = self.T_keyframe_own[k] @ frame.T_keyframe_cam
        return replace(frame, keyframe=int(self.keyframes[k]), T_keyframe_cam=T_keyframe_cam)


@dataclass(frozen=True, kw_only=True)
class TrackResult:
    """The pose of a frame, with its status, keyframe and covariance."""

    frame_index: int
    status: Status
    T_world_cam: np.ndarray  # [4, 4]; of a lost frame: the prediction, not reliable
    keyframe: int  # id of the keyframe that the pose is relative to
    T_keyframe_cam: np.ndarray  # [4, 4]
    quality: float = 0.0  # 0..1
    residual_m: float = math.nan  # RMS of the SDF inliers; nan without a map
    map_version: int = 0  # 0: no map
    is_keyframe: bool = False
    outside: int = 0  # depth points outside the bound
    # version of the keyframe poses that the pose follows; None: that when the frame came
    pose_version: int | None = None
    # [6, 6] as in `geometry/pose_covariance.py`; None: not known
    covariance: np.ndarray | None = None
    # 0: pose and keyframe are in the map; else in this fragment, and the camera is lost to the map
    fragment: int = 0
    is_reckoned: bool = False  # in the fragment, odometry alone placed the frame
    joined: JoinedFragment | None = None  # the fragment that joined the map at this frame
    # [4, 4] T_world_cam by odometry, of the first aligned frame after dead-reckoned ones
    T_expected: np.ndarray | None = None
    is_carried: bool = False  # the motion since the last frame with a pose is not known
    imu_disagrees: bool = False  # it rotates unlike the camera, and is not used
    odometry_disagrees: bool = False  # it moves unlike the camera, and is not used
    # m/s^2 (negative: downwards): mean acceleration of the IMU, if not gravity; None: it is, or is not known
    implausible_gravity: float | None = None

    @classmethod
    def first(cls, frame_index: int, keyframe: int, T_world_cam: np.ndarray) -> "TrackResult":
        """The result of the first frame, which fixes the world."""
        return cls(
            frame_index=frame_index, status="initial", T_world_cam=T_world_cam, keyframe=keyframe,
            T_keyframe_cam=np.eye(4), quality=1.0, is_keyframe=True, covariance=np.zeros((6, 6)),
        )  # fmt: skip

    def log_row(
        self,
        *,
        source_stamp_ns: int,
        stamp_ns: int,
        publish_ns: int,
        publish_monotonic_ns: int = 0,
        pose_version: int = 0,
        map_epoch: int = 0,
        publisher: int = 0,
    ) -> np.ndarray:
        """The row of the pose log, [] of POSE_ROW. `pose_version`: that when the frame came."""
        return pose_row(
            index=self.frame_index,
            source_stamp_ns=source_stamp_ns,
            stamp_ns=stamp_ns,
            publish_ns=publish_ns,
            publish_monotonic_ns=publish_monotonic_ns,
            status=STATUS[self.status],
            keyframe=self.keyframe,
            T_world_cam=self.T_world_cam,
            T_keyframe_cam=self.T_keyframe_cam,
            quality=self.quality,
            map_version=self.map_version,
            pose_version=pose_version if self.pose_version is None else self.pose_version,
            map_epoch=map_epoch,
            publisher=publisher,
            covariance=self.covariance,
            fragment=self.fragment,
            is_reckoned=self.is_reckoned,
        )

    @classmethod
    def without_map(cls, frame_index: int) -> "TrackResult":
        """The result of a frame that comes before the first keyframe and cannot become one."""
        return cls(
            frame_index=frame_index, status="lost", T_world_cam=np.eye(4), keyframe=-1,
            T_keyframe_cam=np.eye(4),
        )  # fmt: skip


def frame_points(
    frame: Frame, config: TrackerConfig, seed: int, averaging: float | None = None
) -> np.ndarray:
    """About `config.points` depth points [N, 3] float32 m, camera frame, none on a depth edge; if their
    depth is averaged, `config.surface_points` if that is more.

    `averaging`: the `averaging_limit` of a frame of the same camera, 1/m; None: it is measured.
    """
    camera = frame.camera
    aspect = camera.width_px / camera.height_px
    window_px = config.depth_window_px
    limit = averaging_limit(frame, window_px) if averaging is None else averaging
    wanted = max(config.points, config.surface_points) if limit else config.points
    # a fifth more cells than points: some fall on edges and holes
    rows = max(1, round(np.sqrt(1.2 * wanted / aspect)))
    columns = max(1, round(rows * aspect))
    jitter = np.random.default_rng((seed, frame.index)).random((rows * columns, 2))
    points = np.empty((rows * columns, 3), np.float32)
    K = np.array([camera.fx, camera.fy, camera.cx, camera.cy], np.float32)
    max_depth_m = np.float32(config.max_depth_m)
    n = sample_points(
        frame.depth_m(), K, jitter, columns, rows, config.border_px, max_depth_m, window_px // 2,
        limit, points,
    )  # fmt: skip
    return points[:n]


def whole_share(depth_raw: np.ndarray) -> float:
    """Share of the pixels of a depth image [H, W] that have depth with depth around them, at which
    `frame_points` looks for points; 0 = no depth."""
    known = depth_raw > 0
    rows, columns = slice(2, -2), slice(2, -2)
    whole = known[rows, columns] & known[:-4, columns] & known[4:, columns]
    whole &= known[rows, :-4] & known[rows, 4:]
    return np.count_nonzero(whole) / max(whole.size, 1)
