"""Where the robot is and how fast it moves, from the poses of its camera; the log and ROS 2 share it."""

from typing import NamedTuple

import numpy as np

from hsslam_node.geometry.pose_covariance import turned
from hsslam_node.geometry.robot_frames import RobotFrames, velocity
from hsslam_node.geometry.se3 import inverse, transform
from hsslam_proto.messages import Pose
from hsslam_proto.pose_codec import covariance_matrix, pose_matrix


class RobotMotion(NamedTuple):
    """The robot at one frame: poses [4, 4], covariances [6, 6] m, rad about the origin of `base_link`.

    `twist`: [6] m/s and rad/s since the frame before, in axes of `base_link`. A field is None if it is
    unknown: in a fragment the poses in `map` and all covariances.
    """

    T_map_base: np.ndarray | None
    T_map_odom: np.ndarray | None
    T_odom_base: np.ndarray
    covariance_in_map: np.ndarray | None
    covariance_in_odom: np.ndarray | None
    twist: np.ndarray | None
    twist_covariance: np.ndarray | None


class RobotPath:
    """Follows poses of the map and of fragments, in their order.

    `by_wall_clock`: speeds are by `stamp_ns`, as with --rate-hz; else by the clock of the source.
    """

    def __init__(self, *, by_wall_clock: bool) -> None:
        self._by_wall_clock = by_wall_clock
        self._last: tuple[int, np.ndarray] | None = None  # stamp, ns, and T_odom_base

    def next(self, pose: Pose, frames: RobotFrames) -> RobotMotion:
        """The robot at the next pose."""
        T_world_cam = transform(np.array(pose.t), np.array(pose.q))
        T_odom_cam = pose_matrix(pose.odometry) if pose.odometry else T_world_cam
        if pose.fragment:
            T_odom_base = frames.in_odom(T_odom_cam)
            twist, _ = self._twist(pose, T_odom_base)
            return RobotMotion(None, None, T_odom_base, None, None, twist, None)
        T_map_base, T_odom_base = frames.base_pose(T_world_cam), frames.in_odom(T_odom_cam)
        T_map_odom = T_map_base @ inverse(T_odom_base)
        twist, seconds = self._twist(pose, T_odom_base)
        in_map = in_odom = of_twist = None
        if (known := covariance_matrix(pose.covariance)) is not None:
            in_map = frames.base_covariance(known, T_world_cam)
            in_odom = turned(in_map, T_map_odom[:3, :3].T)
            if twist is not None:
                of_twist = 2 / seconds**2 * turned(in_map, T_map_base[:3, :3].T)
        return RobotMotion(T_map_base, T_map_odom, T_odom_base, in_map, in_odom, twist, of_twist)

    def _twist(self, pose: Pose, T_odom_base: np.ndarray) -> tuple[np.ndarray | None, float]:
        """Velocity [6] since the pose before, and the time since then, s; None if the motion is unknown, as
        for the first pose."""
        stamp_ns = pose.stamp_ns if self._by_wall_clock else pose.source_stamp_ns
        before, self._last = self._last, (stamp_ns, T_odom_base)
        if before is None or pose.odometry_stands or stamp_ns <= before[0]:
            return None, 0.0
        seconds = 1e-9 * (stamp_ns - before[0])
        return velocity(before[1], T_odom_base, seconds), seconds
