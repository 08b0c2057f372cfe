"""The IMU of a recording of the RealSense viewer: its gyroscope and accelerometer have a topic each.

Both are `sensor_msgs/Imu`, in which the numbers of the other are 0. Their axes are those of the images.
Source: librealsense, src/media/ros/ros_writer.cpp.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.inertial.track import ImuTrack
from hsslam_node.inertial.united import UnitedSample, UnitedSamples
from hsslam_node.sensor_watch import SensorWatch


class RealsenseImu:
    """Takes the messages of both topics, and adds to each frame the reading at its stamp.

    Args:
        T_color_imu: [4, 4] the IMU in the colour camera's optical frame.
        watch: notices faults of the samples.
    """

    def __init__(self, T_color_imu: np.ndarray, watch: SensorWatch) -> None:
        self._track = ImuTrack(T_color_imu, watch)
        self._samples = UnitedSamples()

    def take_gyroscope(self, message: Any, stamp_ns: int) -> None:
        """Take a message, decoded by rosbags, with its stamp.

        Raises:
            UserError: a number is no reading of a sensor.
        """
        turn_rate = _vector(message.angular_velocity)
        self._integrate(self._samples.add_turn_rate(stamp_ns, turn_rate))

    def take_accelerometer(self, message: Any, stamp_ns: int) -> None:
        """As `take_gyroscope`."""
        force = _vector(message.linear_acceleration)
        self._integrate(self._samples.add_force(stamp_ns, force))

    def given(self, frame: Frame) -> Frame:
        """The frame with the reading at its stamp; without one if no sample is near."""
        return replace(frame, imu=self._track.at(frame.stamp_ns))

    def _integrate(self, samples: list[UnitedSample]) -> None:
        for sample in samples:
            self._track.add(*sample)


def _vector(v: Any) -> np.ndarray:
    """Raises:
    UserError: a number is not finite; it would spoil all samples that are interpolated beside it.
    """
    vector = np.array([v.x, v.y, v.z])
    if not np.isfinite(vector).all():
        raise UserError(f"imu: {vector}: expected finite numbers")
    return vector
