"""Reads ROS odometry, `nav_msgs/Odometry`, for the frames of a camera."""

from dataclasses import replace
from typing import Any

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.geometry.se3 import transform
from hsslam_node.odometry.track import OdometryTrack
from hsslam_node.sensor_watch import SensorWatch
from hsslam_node.sources.options.source import SourceOptions
from hsslam_services.ros2.header_stamp import header_stamp_ns

ODOMETRY = "nav_msgs/msg/Odometry"
_UNIT = 1e-2  # largest difference of a quaternion's norm from 1


class RosOdometry:
    """Takes odometry messages in order, and adds odometry to each frame at its stamp.

    The messages are poses of `base_link`; `--base-T-camera` is the pose of the camera in it.
    `watch` notices faults of the messages.
    """

    def __init__(self, options: SourceOptions, watch: SensorWatch | None = None) -> None:
        T_base_cam = RobotFrames.mounted(options.base_T_camera).T_base_cam
        self._track = OdometryTrack(T_base_cam, options.odometry_noise, watch)
        self.has_any = False

    def take(self, message: Any, stamp_ns: int | None = None) -> None:
        """Take a message, decoded by rosbags; ignore one that is not later than the last.

        stamp_ns: stamp of the message; None: that of its header.

        Raises:
            UserError: the position is no reading, or the orientation is no unit quaternion.
        """
        p, o = message.pose.pose.position, message.pose.pose.orientation
        t, q = np.array([p.x, p.y, p.z]), np.array([o.x, o.y, o.z, o.w])
        if not abs(np.linalg.norm(q) - 1) < _UNIT:
            raise UserError(f"odometry: position {t}, orientation {q}: expected a unit quaternion")
        covariance = np.asarray(message.pose.covariance, np.float64).reshape(6, 6)
        if stamp_ns is None:
            stamp_ns = header_stamp_ns(message)
        self._track.add(stamp_ns, transform(t, q), covariance)
        self.has_any = True

    def given(self, frame: Frame) -> Frame:
        """The frame with the odometry at its stamp; without it if no message is near."""
        return replace(frame, odometry=self._track.at(frame.stamp_ns))
