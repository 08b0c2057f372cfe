"""Sensors beside a ROS 2 camera: odometry, an IMU, and the IMU's mounting from `/tf_static`."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import zenoh

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.sensor_watch import SensorWatch
from hsslam_node.sources.files.image_files import BadImageError
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.reports import Report, Reports, sensor_watch
from hsslam_services.camera.ros2_depth import declare_static_transforms, received
from hsslam_services.camera.ros2_messages import CdrMessages, topic_keys
from hsslam_services.ros2.imu_in import IMU, RosImu
from hsslam_services.ros2.odometry_in import ODOMETRY, RosOdometry
from hsslam_services.ros2.static_transforms import TOPIC, StaticTransforms

_RING = 2048  # messages: more than come between two frames


@dataclass(frozen=True)
class _Sensor:
    name: str  # of its option
    topic: str
    type_name: str
    sensor: RosOdometry | RosImu
    subscriber: Any


class Ros2Sensors:
    """Subscribes to the sensors that the options name."""

    def __init__(
        self,
        name: str,
        options: SourceOptions,
        session: zenoh.Session,
        cdr: CdrMessages,
        reports: Reports,
    ) -> None:
        self._cdr = cdr
        self._reports = reports
        self.problem = ""  # error of the newest unusable message
        self.camera_frame = ""  # frame_id of the images, once known
        self._mountings = StaticTransforms()
        ros2 = options.ros2
        self._transforms: Any = None
        if ros2.imu and not options.camera_T_imu:
            self._transforms = declare_static_transforms(session, ros2.domain)
        self._sensors = [
            _Sensor(
                *(option, topic, kind, make(options, sensor_watch(topic, reports.add))),
                session.declare_subscriber(
                    topic_keys(ros2.domain, topic), zenoh.handlers.RingChannel(_RING)
                ),
            )
            for option, topic, kind, make in (
                ("odometry", ros2.topic_of_odometry(name), ODOMETRY, RosOdometry),
                ("imu", ros2.topic_of_imu(name), IMU, self._imu),
            )
            if topic
        ]

    @property
    def silent(self) -> _Sensor | None:
        """The first sensor that has sent nothing; None if all have sent messages."""
        return next((s for s in self._sensors if not s.sensor.has_any), None)

    def hear(self) -> None:
        """Take all received messages; report messages of another type and unusable ones."""
        self._hear_transforms()
        for sensor in self._sensors:
            for payload, type_name in received(sensor.subscriber):
                decode = self._cdr.imu if sensor.type_name == IMU else self._cdr.odometry
                try:
                    sensor.sensor.take(decode(payload, type_name))
                except (BadImageError, UserError) as error:
                    self._report_unusable(sensor.topic, error)

    def _hear_transforms(self) -> None:
        if self._transforms is None:
            return
        for payload, type_name in received(self._transforms):
            try:
                self._mountings.take(self._cdr.transforms(payload, type_name))
            except (BadImageError, UserError) as error:
                self._report_unusable(TOPIC, error)

    def _report_unusable(self, topic: str, error: Exception) -> None:
        self.problem = f"; {topic}: {error}"
        self._reports.add(Report.unusable(topic, error))

    def _imu(self, options: SourceOptions, watch: SensorWatch) -> RosImu:
        return RosImu(options, self._mounted_at, watch)

    def _mounted_at(self, imu_frame: str) -> np.ndarray | None:
        """T_camera_imu, [4, 4], from `/tf_static`; None if not known."""
        return self._mountings.between(self.camera_frame, imu_frame)

    def given(self, frame: Frame) -> Frame:
        """The frame with the readings of the sensors at its stamp."""
        self.hear()
        for sensor in self._sensors:
            frame = sensor.sensor.given(frame)
        return frame
