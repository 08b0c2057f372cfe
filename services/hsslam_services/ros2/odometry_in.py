"""Odometry of ROS, `nav_msgs/Odometry`, read for the frames of a camera."""

from dataclasses import replace
from typing import Any

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.geometry.se3 import transform
from hsslam_node.odometry.track import OdometryTrack
from hsslam_node.sources.options import SourceOptions

ODOMETRY = "nav_msgs/msg/Odometry"
_UNIT = 1e-2  # that the norm of a quaternion may be off


class RosOdometry:
    """Takes messages as they come, and gives frames what odometry says at their stamps.

    Odometry is of `base_link`, on which `--base-T-camera` places the camera.
    """

    def __init__(self, options: SourceOptions) -> None:
        mounted = RobotFrames.mounted(options.base_T_camera)
        self._track = OdometryTrack(mounted.T_base_cam, options.odometry_noise)
        self.has_any = False

    def take(self, message: Any) -> None:
        """Take a message, decoded by rosbags; one that is not later than the last is left out.

        Raises:
            UserError: its numbers are no pose.
        """
        p, o = message.pose.pose.position, message.pose.pose.orientation
        t, q = np.array([p.x, p.y, p.z]), np.array([o.x, o.y, o.z, o.w])
        if not (np.isfinite(t).all() and abs(np.linalg.norm(q) - 1) < _UNIT):
            raise UserError(f"odometry: position {t}, orientation {q}: expected a pose")
        covariance = np.asarray(message.pose.covariance, np.float64).reshape(6, 6)
        stamp = message.header.stamp
        stamp_ns = int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
        self._track.add(stamp_ns, transform(t, q), covariance)
        self.has_any = True

    def given(self, frame: Frame) -> Frame:
        """The frame with what odometry says of it; as it is if odometry has nothing near its stamp."""
        return replace(frame, odometry=self._track.at(frame.stamp_ns))
