"""OpenCV's RGB-D odometry, `cv2.Odometry`: from frame to frame, and against keyframes."""

from collections.abc import Iterable

import cv2
import numpy as np

from hsslam_bench.peers.systems.peer import Estimate
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import so3_log
from hsslam_node.geometry.trajectory import Trajectory

KEYFRAME_M, KEYFRAME_DEG = 0.05, 4.0  # a frame farther from its keyframe is the next keyframe


class _Odometry:
    """Motion between prepared frames, by colour and depth at full size."""

    def __init__(self, camera: Camera) -> None:
        settings = cv2.OdometrySettings()
        settings.setCameraMatrix(camera.K.astype(np.float32))
        kind, algorithm = cv2.OdometryType_RGB_DEPTH, cv2.OdometryAlgoType_COMMON
        self._odometry = cv2.Odometry(kind, settings, algorithm)

    def prepared(self, frame: Frame) -> cv2.OdometryFrame:
        """The frame with its pyramids."""
        grey = cv2.cvtColor(frame.color, cv2.COLOR_RGB2GRAY)
        found = cv2.OdometryFrame(frame.depth_m(), grey)
        self._odometry.prepareFrame(found)
        return found

    def motion(self, a: cv2.OdometryFrame, b: cv2.OdometryFrame) -> np.ndarray | None:
        """T_a_b [4, 4]; None if the odometry fails."""
        try:
            ok, T_a_b = self._odometry.compute(b, a)
        except cv2.error:  # no pixel with depth
            return None
        if not ok or T_a_b is None or not np.isfinite(T_a_b).all():
            return None
        return np.asarray(T_a_b, np.float64)


def from_frame_to_frame(frames: Iterable[Frame]) -> Estimate:
    """Track each frame against the previous one."""
    return _tracked(frames, 0.0, 0.0)


def against_keyframes(frames: Iterable[Frame]) -> Estimate:
    """Track each frame against a keyframe, until the camera is 5 cm or 4 degrees away or tracking fails."""
    return _tracked(frames, KEYFRAME_M, KEYFRAME_DEG)


def _tracked(frames: Iterable[Frame], far_m: float, far_deg: float) -> Estimate:
    """Track frames against keyframes. A frame that fails is tried against the previous frame. If that fails
    too, the frame is lost and becomes a keyframe at the last tracked pose."""
    odometry: _Odometry | None = None
    stamps_ns: list[int] = []
    poses: list[np.ndarray] = []
    keyframe: cv2.OdometryFrame | None = None
    last: cv2.OdometryFrame | None = None
    T_world_keyframe = T_world_last = np.eye(4)
    for frame in frames:
        odometry = odometry or _Odometry(frame.camera)
        current = odometry.prepared(frame)
        T: np.ndarray | None = np.eye(4)
        if keyframe is not None and last is not None:
            T = odometry.motion(keyframe, current)
            if T is None and last is not None and last is not keyframe:
                keyframe, T_world_keyframe = last, T_world_last
                T = odometry.motion(keyframe, current)
        last = current
        if T is not None:
            T_world_last = T_world_keyframe @ T
            stamps_ns.append(frame.stamp_ns)
            poses.append(T_world_last)
        if keyframe is None or T is None or _is_far(T, far_m, far_deg):
            keyframe, T_world_keyframe = current, T_world_last
    return Estimate(Trajectory(np.array(stamps_ns, np.int64), np.array(poses).reshape(-1, 4, 4)))


def _is_far(T: np.ndarray, far_m: float, far_deg: float) -> bool:
    turned_deg = np.rad2deg(np.linalg.norm(so3_log(T[:3, :3])))
    return bool(np.linalg.norm(T[:3, 3]) >= far_m or turned_deg >= far_deg)
