"""ROS 2 over rmw_zenoh: topic keys, and CDR payloads of sensor_msgs as images and cameras."""

import re
from typing import Any

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera, LensModel, expect_lens
from hsslam_node.sources.files.image_files import BadImageError
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.reports import Report, Reports
from hsslam_node.sources.ros2.raw_image import RawImage
from hsslam_services.ros2.header_stamp import header_stamp_ns
from hsslam_services.ros2.imu_in import IMU
from hsslam_services.ros2.odometry_in import ODOMETRY
from hsslam_services.ros2.static_transforms import TRANSFORMS
from hsslam_services.ros2.type_store import open_type_store

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
INFO = "sensor_msgs/msg/CameraInfo"
_RECTIFIED = frozenset(("rect", "rectified"))
_LENSES: dict[str, tuple[LensModel, int]] = {  # name in ROS: model, number of coefficients
    "plumb_bob": ("opencv", 5),
    "rational_polynomial": ("opencv", 5),  # more if the others are not all 0
    "equidistant": ("equidistant", 4),
}
# The RealSense SDK's names, taken as its ROS driver takes them.
_LENSES_OF_REALSENSE: dict[str, tuple[LensModel, int]] = {
    "Brown Conrady": ("opencv", 5),
    "Modified Brown Conrady": ("opencv", 5),
    "Inverse Brown Conrady": ("opencv", 5),
    "Kannala Brandt4": ("equidistant", 4),
}


def check_ros2(name: str, options: SourceOptions) -> None:
    """Raise UserError if `name` is no ROS 2 namespace, or if rosbags is not installed."""
    options.ros2.topics_under(name)
    CdrMessages()


class CdrMessages:
    """Decodes messages with the package rosbags; `is_ros1`: in the format of ROS 1 instead of CDR.

    Raises:
        UserError: rosbags is not installed.
    """

    def __init__(self, who: str = "source ros2", is_ros1: bool = False) -> None:
        store = open_type_store(who, is_ros1)
        from rosbags.serde import SerdeError

        self._deserialize = store.deserialize_ros1 if is_ros1 else store.deserialize_cdr
        self._format = "the format of ROS 1" if is_ros1 else "CDR"
        self._error = SerdeError

    def image(self, payload: bytes, type_name: str) -> RawImage:
        """An `Image` or a `CompressedImage`.

        Raises:
            BadImageError: another type, or not such a message.
        """
        if type_name not in (IMAGE, COMPRESSED):
            raise BadImageError(f"message of type {type_name or 'unknown'}: expected {IMAGE}")
        message = self._decoded(payload, type_name)
        stamp_ns, frame_id = header_stamp_ns(message), str(message.header.frame_id)
        data = np.asarray(message.data, np.uint8)
        if type_name == COMPRESSED:
            encoding = str(message.format)
            return RawImage(stamp_ns, encoding, data, is_compressed=True, frame_id=frame_id)
        return RawImage(
            stamp_ns=stamp_ns,
            encoding=str(message.encoding),
            data=data,
            width_px=int(message.width),
            height_px=int(message.height),
            step_bytes=int(message.step),
            is_big_endian=bool(message.is_bigendian),
            frame_id=frame_id,
        )

    def camera(self, payload: bytes, type_name: str, is_rectified: bool) -> Camera:
        """The camera of a `CameraInfo`: K and D, or P of rectified images, of the pixels that are left by
        binning and region of interest.

        Raises:
            BadImageError: another type, or not such a message.
            UserError: invalid numbers, or an unknown lens model.
        """
        if type_name != INFO:
            raise BadImageError(f"message of type {type_name or 'unknown'}: expected {INFO}")
        info = self._decoded(payload, type_name)
        if is_rectified:
            p = _numbers(info, "p")
            if not any(p):
                raise UserError("camera_info.p is all 0: expected P of images that are rectified")
            return Camera(*_pixels_left(info, p[0], p[5], p[2], p[6]))
        k = _numbers(info, "k")
        lens, model = _lens(str(info.distortion_model), _numbers(info, "d"))
        return Camera(*_pixels_left(info, k[0], k[4], k[2], k[5]), lens, model)

    def has_lens(self, payload: bytes) -> bool:
        """Whether a `CameraInfo` has coefficients of a lens that are not all 0.

        Raises:
            BadImageError: not such a message.
        """
        return any(_numbers(self._decoded(payload, INFO), "d"))

    def odometry(self, payload: bytes, type_name: str) -> Any:
        """An `Odometry` as rosbags decodes it.

        Raises:
            BadImageError: another type, or not such a message.
        """
        return self.of_type(payload, type_name, ODOMETRY)

    def imu(self, payload: bytes, type_name: str) -> Any:
        """An `Imu` as rosbags decodes it.

        Raises:
            BadImageError: another type, or not such a message.
        """
        return self.of_type(payload, type_name, IMU)

    def transforms(self, payload: bytes, type_name: str) -> Any:
        """A `TFMessage` as rosbags decodes it.

        Raises:
            BadImageError: another type, or not such a message.
        """
        return self.of_type(payload, type_name, TRANSFORMS)

    def of_type(self, payload: bytes, type_name: str, expected: str) -> Any:
        """A message of type `expected` as rosbags decodes it.

        Raises:
            BadImageError: another type, or not such a message.
        """
        if type_name != expected:
            raise BadImageError(f"message of type {type_name or 'unknown'}: expected {expected}")
        return self._decoded(payload, type_name)

    def _decoded(self, payload: bytes, type_name: str) -> Any:
        try:
            return self._deserialize(payload, type_name)
        except self._error as error:
            raise BadImageError(f"no {type_name} in {self._format}: {error}") from None


def _pixels_left(
    info: Any, fx: float, fy: float, cx: float, cy: float
) -> tuple[int, int, float, float, float, float]:
    """Width, height, fx, fy, cx and cy of the images, from those of the sensor's full resolution.

    The driver cuts out the region of interest, then joins pixels. Source: sensor_msgs/CameraInfo, and
    image_geometry's PinholeCameraModel.
    """
    roi = info.roi
    across, down = max(int(info.binning_x), 1), max(int(info.binning_y), 1)
    width_px, height_px = int(roi.width) or int(info.width), int(roi.height) or int(info.height)
    cx, cy = cx - int(roi.x_offset), cy - int(roi.y_offset)
    return width_px // across, height_px // down, fx / across, fy / down, cx / across, cy / down


def _numbers(info: Any, name: str) -> list[float]:
    """A matrix or list of `CameraInfo`; its name is upper case in ROS 1."""
    return [float(v) for v in getattr(info, name if hasattr(info, name) else name.upper())]


def _lens(name: str, lens: list[float]) -> tuple[tuple[float, ...], LensModel]:
    """OpenCV's coefficients, without trailing ones that are all 0, and their model."""
    if not any(lens):
        return (), "opencv"
    found = _LENSES.get(name) or _LENSES_OF_REALSENSE.get(name)
    if found is None:
        raise UserError(
            f"camera_info.distortion_model = {name!r}: expected {', '.join(_LENSES)}, or rectified images"
        )
    model, count = found
    kept = lens if any(lens[count:]) else lens[:count]
    expect_lens("camera_info.d", kept, model)
    return tuple(kept), model


def is_rectified(topic: str) -> bool:
    """Whether the images of a topic are rectified: its name has the word "rect" or "rectified"."""
    return not _RECTIFIED.isdisjoint(re.split(r"[/_]", topic))


def report_one_rectified(color: str, depth: str, option: str, reports: Reports) -> None:
    """Report if the names of two topics say that only one of them has rectified images.

    Matters only for a camera with a lens. `option`: the beginning of the options of topics, such as `--bag`.
    """
    if is_rectified(color) == is_rectified(depth):
        return
    rectified, raw = (color, depth) if is_rectified(color) else (depth, color)
    distortion = "stays in depth" if rectified == color else "is removed from both"
    text = (
        f"{rectified} is rectified by its name, {raw} is not: the lens distortion of camera_info "
        f"{distortion}; expected topics that are both rectified or both raw ({option}.color, {option}.depth)"
    )
    reports.add(Report("only one of colour and depth is rectified", text))


def topic_keys(domain: int, topic: str) -> str:
    """The key expression of a topic such as `/camera/color/image_raw`."""
    return f"{domain}/{topic.strip('/')}/*/*"


def all_topics(domain: int) -> str:
    """The key expression of all messages of sensor_msgs in a domain."""
    return f"{domain}/**/sensor_msgs$*/*"


def type_of(key: str) -> str:
    """The message type of a key, such as `sensor_msgs/msg/Image`; empty if it is not a key of ROS."""
    match = re.fullmatch(r".+/(\w+)::msg::dds_::(\w+)_/[^/]+", key)
    return f"{match[1]}/msg/{match[2]}" if match else ""


def topic_of(key: str) -> str:
    """The topic of a key, such as `/camera/color/image_raw`."""
    return "/" + "/".join(key.split("/")[1:-2])
