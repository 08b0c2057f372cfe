"""A camera as rmw_zenoh publishes it, its messages encoded by pycdr2, which we do not use."""

import threading
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import zenoh
from pycdr2 import IdlStruct
from pycdr2.types import array, float64, sequence, uint8, uint32

from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.topics import Ros2Options
from tests.services.ros2.ros_types import (
    Header,
    Odometry,
    Pose,
    PoseWithCovariance,
    Quaternion,
    Time,
    Twist,
    TwistWithCovariance,
    Vector3,
)

FIRST_NS = 1_700_000_000_000_000_000
_HASH = "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47"


@dataclass
class Image(IdlStruct):
    header: Header
    height: uint32
    width: uint32
    encoding: str
    is_bigendian: uint8
    step: uint32
    data: sequence[uint8]


@dataclass
class CompressedImage(IdlStruct):
    header: Header
    format: str
    data: sequence[uint8]


@dataclass
class RegionOfInterest(IdlStruct):
    x_offset: uint32
    y_offset: uint32
    height: uint32
    width: uint32
    do_rectify: bool


@dataclass
class CameraInfo(IdlStruct):
    header: Header
    height: uint32
    width: uint32
    distortion_model: str
    d: sequence[float64]
    k: array[float64, 9]
    r: array[float64, 9]
    p: array[float64, 12]
    binning_x: uint32
    binning_y: uint32
    roi: RegionOfInterest


def odometry(stamp_ns: int, numbers: Sequence[float]) -> Odometry:
    """Of a base at x, y, z, qx, qy, qz, qw, as many drivers send it: with a constant covariance."""
    pose = Pose(Vector3(*numbers[:3]), Quaternion(*numbers[3:]))
    still = Twist(Vector3(0.0, 0.0, 0.0), Vector3(0.0, 0.0, 0.0))
    constant = [0.1] * 36
    return Odometry(
        header(stamp_ns), "base_link", PoseWithCovariance(pose, constant),
        TwistWithCovariance(still, constant),
    )  # fmt: skip


@dataclass
class Imu(IdlStruct):
    header: Header
    orientation: Quaternion
    orientation_covariance: array[float64, 9]
    angular_velocity: Vector3
    angular_velocity_covariance: array[float64, 9]
    linear_acceleration: Vector3
    linear_acceleration_covariance: array[float64, 9]


def imu(
    stamp_ns: int,
    rates: Sequence[float],
    forces: Sequence[float],
    of_rates: float = 0.0,
    frame: str = "camera_imu_frame",
) -> Imu:
    """Without orientation, as drivers of plain IMUs send it."""
    unknown, none = [-1.0] + [0.0] * 8, [0.0] * 9
    return Imu(
        header(stamp_ns, frame), Quaternion(0.0, 0.0, 0.0, 1.0), unknown,
        Vector3(*rates), [of_rates, *none[1:]], Vector3(*forces), none,
    )  # fmt: skip


def header(stamp_ns: int, frame: str = "camera_color_optical_frame") -> Header:
    return Header(Time(stamp_ns // 10**9, stamp_ns % 10**9), frame)


def image(stamp_ns: int, pixels: np.ndarray, encoding: str) -> Image:
    height, width = pixels.shape[:2]
    step = pixels.nbytes // height
    return Image(header(stamp_ns), height, width, encoding, 0, step, pixels.tobytes())


def camera_info(stamp_ns: int, camera: Camera, model: str = "plumb_bob") -> CameraInfo:
    k = [float(v) for v in camera.K.ravel()]
    p = [2 * camera.fx, 0.0, camera.cx, 0.0, 0.0, 2 * camera.fy, camera.cy, 0.0, 0.0, 0.0, 1.0, 0.0]
    lens = list(camera.distortion or 5 * (0.0,))
    roi = RegionOfInterest(0, 0, 0, 0, False)
    eye = [float(v) for v in np.eye(3).ravel()]
    size = (camera.height_px, camera.width_px)
    return CameraInfo(header(stamp_ns), *size, model, lens, k, eye, p, 0, 0, roi)


class RosCamera:
    """Publishes in a peer session, such as ROS nodes have."""

    def __init__(self, endpoint: str, topics: tuple[str, str, str] | None = None) -> None:
        config = zenoh.Config()
        config.insert_json5("mode", '"peer"')
        config.insert_json5("connect/endpoints", f'["{endpoint}"]')
        config.insert_json5("listen/endpoints", '["tcp/127.0.0.1:0"]')
        config.insert_json5("scouting/multicast/enabled", "false")
        self._session = zenoh.open(config)
        self.topics = topics or (
            "/camera/color/image_raw",
            "/camera/aligned_depth_to_color/image_raw",
            "/camera/color/camera_info",
        )
        self.info = Camera(1, 1, 1.0, 1.0, 0.0, 0.0)  # what it publishes once it is started
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None

    def put(self, topic: str, message: IdlStruct | bytes, type_name: str = "Image") -> None:
        """One message on a topic of domain 0."""
        payload = message if isinstance(message, bytes) else message.serialize()
        package = "nav_msgs" if type_name == "Odometry" else "sensor_msgs"
        key = f"0{topic}/{package}::msg::dds_::{type_name}_/{_HASH}"
        self._session.put(key, payload)

    def start(
        self,
        frames: Sequence[Frame],
        rate_hz: float = 30.0,
        depth_lag_ns: int = 0,
        camera: Camera | None = None,
    ) -> None:
        """Publish all frames from a thread, to and fro, with stamps that run on."""
        there_and_back = [*frames, *frames[-2:0:-1]]
        packed = [(f.color, (f.depth_m() * 1000).astype(np.uint16)) for f in there_and_back]
        self.info = frames[0].camera if camera is None else camera
        color_topic, depth_topic, info_topic = self.topics

        def run() -> None:
            k = 0
            while not self._ended.wait(1 / rate_hz):
                stamp_ns = FIRST_NS + round(k * 1e9 / rate_hz)
                color, depth = packed[k % len(packed)]
                self.put(info_topic, camera_info(stamp_ns, self.info), "CameraInfo")
                self.put(color_topic, image(stamp_ns, color, "rgb8"))
                self.put(depth_topic, image(stamp_ns + depth_lag_ns, depth, "16UC1"))
                k += 1

        self._thread = threading.Thread(target=run, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Publish nothing more."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join()

    def close(self) -> None:
        self.stop()
        self._session.close()


def ros2_options(endpoint: str, frames: int | None = None, **fields) -> SourceOptions:
    """The options of a source that finds this camera; `fields`: of `Ros2Options`."""
    return SourceOptions(frames=frames, ros2=Ros2Options(connect=endpoint, **fields))
