"""Adds IMU readings from `in/imu` to the frames of the camera; apart as `odometry_inlet.py` is."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.robot_frames import mounting
from hsslam_node.inertial.track import ImuTrack
from hsslam_node.sources.reports import Report, sensor_watch
from hsslam_proto.messages import ImuSamples
from hsslam_services.bus.subscription import Subscription


class ImuInlet:
    """Integrates the IMU samples before each frame. Stamps are wall clock, as of frames.

    Args:
        camera_T_imu: numbers of `--camera-T-imu`.
        tell: gets a report of each sample that is no reading, and of faults of the stamps.
    """

    def __init__(
        self,
        messages: Subscription[ImuSamples],
        camera_T_imu: Sequence[float],
        tell: Callable[[Report], None] = lambda _: None,
    ) -> None:
        self._messages, self._tell = messages, tell
        self._track = ImuTrack(
            mounting("--camera-T-imu", camera_T_imu),
            sensor_watch(messages.topic.name, tell),
        )

    def given(self, frame: Frame, stamp_ns: int) -> Frame:
        """The frame with the IMU reading at this stamp; unchanged if it has one or there is none."""
        for message in self._messages.drain():
            samples = zip(
                message.stamps_ns, message.angular_velocity, message.acceleration, strict=True
            )
            for sample_ns, turn_rate, force in samples:
                try:
                    self._track.add(sample_ns, np.array(turn_rate), np.array(force))
                except UserError as error:
                    self._tell(Report.unusable(self._messages.topic.name, error))
        reading = None if frame.imu is not None else self._track.at(stamp_ns)
        return frame if reading is None else replace(frame, imu=reading)
