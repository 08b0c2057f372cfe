"""Sensors beside the camera of a bag: odometry and an IMU."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.robot_frames import mounting
from hsslam_node.sources.files.image_files import BadImageError
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.reports import Report, Reports, sensor_watch
from hsslam_services.camera.bags import realsense_recording
from hsslam_services.camera.bags.bag_file import BagFile, BagMessage
from hsslam_services.camera.bags.bag_topics import chosen_topic
from hsslam_services.camera.bags.realsense_imu import RealsenseImu
from hsslam_services.ros2.imu_in import IMU, RosImu
from hsslam_services.ros2.odometry_in import ODOMETRY, RosOdometry
from hsslam_services.ros2.static_transforms import StaticTransforms


@dataclass(frozen=True)
class SensorTopics:
    """The topics of the sensors, and where the IMU is mounted."""

    odometry: str  # empty: none
    imu: tuple[str, ...]  # one; gyroscope and accelerometer of a RealSense recording; or none
    T_color_imu: np.ndarray | None  # [4, 4]; None: not known, but perhaps by `transforms`
    transforms: StaticTransforms
    camera_frame: str  # frame_id of the images


def find_sensors(
    bag: BagFile, options: SourceOptions, color: str, camera_frame: str, reports: Reports
) -> SensorTopics:
    """The topics that the options name. Else the IMU of a RealSense recording, if this has its pose in the
    camera of the topic `color`; if `--camera-T-imu` is set, the only IMU of the bag.

    Raises:
        UserError: the bag has no such topic, no messages of it, or several IMUs; names all topics.
    """
    odometry = ""
    if asked := options.bag.odometry:
        odometry = chosen_topic(bag, "odometry", asked, (), _with_messages(bag, ODOMETRY))
    imu, is_default = _imu_topics(bag, options, color)
    T_color_imu, transforms = None, StaticTransforms()
    if options.camera_T_imu:
        T_color_imu = mounting("--camera-T-imu", options.camera_T_imu)
    elif len(imu) == 2:
        T_color_imu = _recorded_mounting(bag, color, imu[0], reports)
    elif imu:
        transforms = bag.static_transforms(reports)
    if T_color_imu is None and is_default:
        imu = ()
    return SensorTopics(odometry, imu, T_color_imu, transforms, camera_frame)


class BagSensors:
    """Takes the messages of sensors in the order of the bag, and adds their readings to frames."""

    def __init__(
        self, bag: BagFile, options: SourceOptions, topics: SensorTopics, reports: Reports
    ) -> None:
        self._bag = bag
        self._reports = reports
        self._sensors: list[RosOdometry | RosImu | RealsenseImu] = []
        self._take: dict[str, Callable[[Any, int], None]] = {}  # by topic
        self._odometry = topics.odometry
        if topic := topics.odometry:
            odometry = RosOdometry(options, sensor_watch(topic, reports.add))
            self._sensors.append(odometry)
            self._take[topic] = odometry.take
        if len(topics.imu) == 2:
            T_color_imu = np.eye(4) if topics.T_color_imu is None else topics.T_color_imu
            both = RealsenseImu(T_color_imu, sensor_watch(topics.imu[0], reports.add))
            self._sensors.append(both)
            takes = both.take_gyroscope, both.take_accelerometer
            self._take |= dict(zip(topics.imu, takes, strict=True))
        elif topics.imu:
            mounted_at = partial(topics.transforms.between, topics.camera_frame)
            imu = RosImu(options, mounted_at, sensor_watch(topics.imu[0], reports.add))
            self._sensors.append(imu)
            self._take[topics.imu[0]] = imu.take

    @property
    def topics(self) -> tuple[str, ...]:
        """Those whose messages it takes."""
        return tuple(self._take)

    def take(self, message: BagMessage) -> None:
        """Take a message of one of the topics; one that cannot be used is reported."""
        decode = self._bag.decode
        of_kind = decode.odometry if message.topic == self._odometry else decode.imu
        try:
            decoded = of_kind(message.payload, message.type_name)
            self._take[message.topic](decoded, message.stamp_ns)
        except (BadImageError, UserError) as error:
            self._reports.add(Report.unusable(message.topic, error))

    def given(self, frame: Frame) -> Frame:
        """The frame with the readings of the sensors at its stamp."""
        for sensor in self._sensors:
            frame = sensor.given(frame)
        return frame


def _imu_topics(bag: BagFile, options: SourceOptions, color: str) -> tuple[tuple[str, ...], bool]:
    """The topics of the IMU, and whether no option asks for it: then it is that of the camera of `color`."""
    imus = _with_messages(bag, IMU)
    pairs = realsense_recording.imu_pairs(imus)
    if not (options.bag.imu or (options.camera_T_imu and imus)):
        beside = [p for p in pairs if realsense_recording.are_of_one_device(color, p[0])]
        return (beside[0] if len(beside) == 1 else ()), True
    accelerometers = {accelerometer for _, accelerometer in pairs}
    fitting = [topic for topic in imus if topic not in accelerometers]
    topic = chosen_topic(bag, "imu", options.bag.imu, fitting, imus)
    return next((pair for pair in pairs if topic in pair), (topic,)), False


def _with_messages(bag: BagFile, type_name: str) -> list[str]:
    """The topics of this type that have messages."""
    return [t.name for t in bag.topics if t.type_name == type_name and t.message_count]


def _recorded_mounting(bag: BagFile, color: str, imu: str, reports: Reports) -> np.ndarray | None:
    """T_color_imu, [4, 4], of a RealSense recording; None if it has none. One that is invalid is reported."""
    try:
        return realsense_recording.mounted_at(bag, color, imu)
    except (BadImageError, UserError) as error:
        kind = f"{imu}: mounting"
        reports.add(Report(kind, f"{kind}: {error}; the recording counts as without it"))
        return None
