"""Converts the library's frames to messages and back; restamps logged frames for a replay."""

import time
from typing import Any

import msgspec
import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.image_header import image_header
from hsslam_node.inertial.reading import ImuReading
from hsslam_node.odometry.reading import OdometryReading
from hsslam_proto import messages
from hsslam_proto.pose_codec import covariance_matrix, wire_covariance
from hsslam_proto.topics import FRAME

_BYTES_A_PIXEL = 5  # of colour and depth
_OTHER_BYTES = 1 << 16  # room for the other fields
LARGEST_IMAGE_PX = (FRAME.size_limit_bytes - _OTHER_BYTES) // _BYTES_A_PIXEL


def frame_message(
    frame: Frame, stamp_ns: int, publisher: int = 0, source_wait_ns: int = 0
) -> messages.Frame:
    """The frame as an uncompressed message that shares its arrays; `stamp_ns`: wall clock.

    `publisher`: number of the camera, from `new_publisher`; 0: none. `source_wait_ns`: as in the message.
    """
    camera, reading, imu = frame.camera, frame.odometry, frame.imu
    covariance = None if reading is None else reading.covariance
    return messages.Frame(
        index=frame.index,
        stamp_ns=stamp_ns,
        source_stamp_ns=frame.stamp_ns,
        width_px=camera.width_px,
        height_px=camera.height_px,
        fx=camera.fx,
        fy=camera.fy,
        cx=camera.cx,
        cy=camera.cy,
        color=np.ascontiguousarray(frame.color).data.cast("B"),
        depth=np.ascontiguousarray(frame.depth_raw, "<u2").data.cast("B"),
        depth_units_per_m=frame.depth_units_per_m,
        publisher=publisher,
        odometry=[] if reading is None else reading.numbers.tolist(),
        odometry_covariance=[] if covariance is None else wire_covariance(covariance),
        odometry_series=0 if reading is None else reading.series,
        imu=[] if imu is None else imu.numbers.tolist(),
        imu_series=0 if imu is None else imu.series,
        source_wait_ns=source_wait_ns,
    )


def frame_from_message(message: messages.Frame, publisher: int = 0) -> Frame:
    """The frame in a message, with copies of its arrays; its `stamp_ns` is the message's `source_stamp_ns`.

    `publisher`: number of the camera, for messages without one; 0: that of the message.

    Raises:
        UserError: a compressed image cannot be read or has another size.
    """
    return Frame(
        index=message.index,
        stamp_ns=message.source_stamp_ns,
        camera=frame_camera(message),
        color=_owned(color_image(message)),
        depth_raw=_owned(depth_image(message)),
        depth_units_per_m=message.depth_units_per_m,
        odometry=_odometry_reading(message, publisher or message.publisher),
        imu=ImuReading(np.array(message.imu), message.imu_series) if message.imu else None,
    )


def frame_camera(message: messages.Frame) -> Camera:
    """The camera of a frame message; UserError if it has numbers that no camera has."""
    return Camera(
        message.width_px, message.height_px, message.fx, message.fy, message.cx, message.cy
    )


def _odometry_reading(message: messages.Frame, publisher: int) -> OdometryReading | None:
    """The reading; its series differs from camera to camera, as a restarted driver has a new publisher."""
    if not message.odometry:
        return None
    covariance = covariance_matrix(message.odometry_covariance)
    series = message.odometry_series ^ publisher
    return OdometryReading(np.array(message.odometry), covariance, series)


def color_image(message: messages.Frame) -> np.ndarray:
    """Colour of a frame message, [H, W, 3] uint8 RGB, a view if it is raw; UserError if it cannot be read or
    has another size."""
    if message.color_encoding == "rgb8":
        return np.frombuffer(message.color, np.uint8).reshape((*_size(message), 3))
    from hsslam_node.image_decoding import decoded_rgb

    expect_headers(message)
    image = decoded_rgb(message.color)
    if image is None or image.shape[:2] != _size(message):
        raise _not_an_image(message, "color", message.color_encoding.upper(), _found(image))
    return image


def depth_image(message: messages.Frame) -> np.ndarray:
    """Depth of a frame message, [H, W] uint16, a view if it is raw; UserError if it is no 16-bit PNG of this
    size."""
    if message.depth_encoding == "u16":
        return np.frombuffer(message.depth, "<u2").reshape(_size(message))
    from hsslam_node.image_decoding import decoded_as_stored

    expect_headers(message)
    image = decoded_as_stored(message.depth)
    if image is None or image.dtype != np.uint16 or image.shape != _size(message):
        raise _not_an_image(message, "depth", "16-bit PNG", _found(image))
    return image


def expect_headers(message: messages.Frame) -> None:
    """Check the headers of compressed images, without decoding them.

    Raises:
        UserError: an image has another encoding, size or pixel type than the message requires.
    """
    for field, encoding in (("color", message.color_encoding), ("depth", message.depth_encoding)):
        if encoding not in ("jpeg", "png"):
            continue
        header = image_header(getattr(message, field))
        kind = encoding.upper() if field == "color" else "16-bit PNG"
        if header is None:
            raise _not_an_image(message, field, kind, "unreadable")
        is_meant = header.kind == encoding and {header.width_px, header.height_px} == set(
            _size(message)
        )
        if field == "depth":
            is_meant &= (header.channels, header.bits) == (1, 16)
        if not is_meant:
            size = f"{header.width_px}x{header.height_px}"
            found = (
                f"a {header.kind.upper()} of {size}, {header.bits} bit, {header.channels} channels"
            )
            raise _not_an_image(message, field, kind, found)


def _owned(view: np.ndarray) -> np.ndarray:
    # bytes of a payload are read-only and not aligned: numba would compile kernels for other types
    return np.require(view, requirements=["ALIGNED", "WRITEABLE", "C_CONTIGUOUS"])


def _size(message: messages.Frame) -> tuple[int, int]:
    return message.height_px, message.width_px


def _found(image: Any) -> str:
    return "unreadable" if image is None else f"{image.dtype}{list(image.shape)}"


def _not_an_image(message: messages.Frame, field: str, kind: str, found: str) -> UserError:
    height, width = _size(message)
    return UserError(
        f"in/frame {message.index}: {field} is {found}: expected a {kind} of {width}x{height}"
    )


def restamped(frame: messages.Frame, publisher: int) -> messages.Frame:
    """The frame with the wall clock of now as `stamp_ns`, so that latencies are those of the replay;
    `source_stamp_ns`, which trajectories list, stays."""
    return msgspec.structs.replace(
        frame, stamp_ns=time.time_ns(), publisher=publisher, source_wait_ns=0
    )
