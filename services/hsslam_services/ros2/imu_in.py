"""Integrates messages of a ROS IMU, `sensor_msgs/Imu`, for the frames of a camera."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.robot_frames import mounting
from hsslam_node.inertial.track import ImuTrack
from hsslam_node.sensor_watch import SensorWatch
from hsslam_node.sources.options.source import SourceOptions
from hsslam_services.ros2.header_stamp import header_stamp_ns

IMU = "sensor_msgs/msg/Imu"


class RosImu:
    """Takes IMU messages in order, and adds to each frame the reading at its stamp.

    The messages are in the axes of the IMU; `--camera-T-imu` is its pose in the camera's optical frame. If
    the option is not set, `mounted_at` gives the pose; until then the IMU is in the camera's centre and has
    its axes.

    Args:
        mounted_at: returns T_camera_imu, [4, 4], of an IMU with this frame_id; None: unknown.
        watch: notices faults of the messages.
    """

    def __init__(
        self,
        options: SourceOptions,
        mounted_at: Callable[[str], np.ndarray | None] = lambda _: None,
        watch: SensorWatch | None = None,
    ) -> None:
        self._watch = watch
        T_camera_imu = mounting("--camera-T-imu", options.camera_T_imu)
        self._track = ImuTrack(T_camera_imu, watch)
        self._is_mounted = bool(options.camera_T_imu)
        self._mounted_at = mounted_at
        self.has_any = False

    def take(self, message: Any, stamp_ns: int | None = None) -> None:
        """Take a message, decoded by rosbags; ignore one that is not later than the last.

        stamp_ns: stamp of the message; None: that of its header.

        Raises:
            UserError: a number is no reading of a sensor, or the message lacks angular velocity or
                acceleration.
        """
        turn_rate, force = (
            np.array([v.x, v.y, v.z])
            for v in (message.angular_velocity, message.linear_acceleration)
        )
        covariances = message.angular_velocity_covariance, message.linear_acceleration_covariance
        for name, covariance in zip(("angular velocity", "acceleration"), covariances, strict=True):
            if covariance[0] == -1:  # REP 145: not measured
                raise UserError(
                    f"imu: no {name}, its covariance is -1: expected angular velocity and acceleration in "
                    "one message, as with unite_imu_method of realsense2_camera"
                )
        self._mount(str(message.header.frame_id))
        if stamp_ns is None:
            stamp_ns = header_stamp_ns(message)
        self._track.add(stamp_ns, turn_rate, force)
        self.has_any = True

    def _mount(self, frame_id: str) -> None:
        """Restart the integration as soon as the mounting of the IMU is known."""
        if self._is_mounted:
            return
        T_camera_imu = self._mounted_at(frame_id)
        if T_camera_imu is not None:
            self._track = ImuTrack(T_camera_imu, self._watch)
            self._is_mounted = True

    def given(self, frame: Frame) -> Frame:
        """The frame with the reading at its stamp; without one if no sample is near."""
        return replace(frame, imu=self._track.at(frame.stamp_ns))
