"""Compresses frames for the log and the viewer."""

from typing import Literal

import cv2
import msgspec

from hsslam_node.png.encode import encode_png
from hsslam_proto.frame_codec import color_image, depth_image, expect_headers
from hsslam_proto.messages import Frame

_JPEG = [cv2.IMWRITE_JPEG_QUALITY, 90]


def compress_frame(frame: Frame, color: Literal["jpeg", "png"] = "jpeg") -> Frame:
    """The frame with colour as JPEG (quality 90) or lossless PNG and depth as lossless 16-bit PNG.

    Colour that comes as JPEG stays unchanged; only its header is checked.

    Raises:
        UserError: an image cannot be read, or its size differs from that in the message.
    """
    expect_headers(frame)
    is_jpeg = color == "jpeg" or frame.color_encoding == "jpeg"
    return msgspec.structs.replace(
        frame,
        color=memoryview(jpeg(frame) if is_jpeg else _color_png(frame)),
        color_encoding="jpeg" if is_jpeg else "png",
        depth=memoryview(_depth_png(frame)),
        depth_encoding="png",
    )


def jpeg(frame: Frame) -> bytes:
    """Colour as JPEG; a JPEG stays unchanged."""
    if frame.color_encoding == "jpeg":
        return bytes(frame.color)
    image = cv2.cvtColor(color_image(frame), cv2.COLOR_RGB2BGR)
    return cv2.imencode(".jpg", image, _JPEG)[1].tobytes()


def _color_png(frame: Frame) -> bytes:
    if frame.color_encoding == "png":
        return bytes(frame.color)
    return encode_png(color_image(frame))


def _depth_png(frame: Frame) -> bytes:
    if frame.depth_encoding == "png":
        return bytes(frame.depth)
    return encode_png(depth_image(frame))
