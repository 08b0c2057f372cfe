"""Frames made small for the log and the viewer."""

from typing import Literal

import cv2
import msgspec
import numpy as np

from hsslam_node.proto.frame_codec import color_image, depth_image
from hsslam_node.proto.messages import Frame

_JPEG = [cv2.IMWRITE_JPEG_QUALITY, 90]
# run lengths of horizontal differences: 3.9 ms and 122 kB for a Kinect frame, where the default search
# for repeats takes 5.5 ms for 131 kB
_PNG = [
    *(cv2.IMWRITE_PNG_COMPRESSION, 1),
    *(cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_SUB),
    *(cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE),
]
_COLOR_PNG = [
    *(cv2.IMWRITE_PNG_COMPRESSION, 1),
    *(cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_SUB),
]


def compress_frame(frame: Frame, color: Literal["jpeg", "png"] = "jpeg") -> Frame:
    """The frame with colour as JPEG (quality 90) or lossless PNG and depth as lossless 16-bit PNG.

    Colour that comes as JPEG stays as it came.
    """
    is_jpeg = color == "jpeg" or frame.color_encoding == "jpeg"
    return msgspec.structs.replace(
        frame,
        color=memoryview(jpeg(frame) if is_jpeg else _color_png(frame)),
        color_encoding="jpeg" if is_jpeg else "png",
        depth=memoryview(_depth_png(frame)),
        depth_encoding="png",
    )


def jpeg(frame: Frame) -> bytes:
    """Colour as JPEG; one that comes as JPEG is passed on."""
    if frame.color_encoding == "jpeg":
        return bytes(frame.color)
    return _encode(".jpg", cv2.cvtColor(color_image(frame), cv2.COLOR_RGB2BGR), _JPEG)


def _color_png(frame: Frame) -> bytes:
    if frame.color_encoding == "png":
        return bytes(frame.color)
    return _encode(".png", cv2.cvtColor(color_image(frame), cv2.COLOR_RGB2BGR), _COLOR_PNG)


def _depth_png(frame: Frame) -> bytes:
    if frame.depth_encoding == "png":
        return bytes(frame.depth)
    return _encode(".png", depth_image(frame), _PNG)


def _encode(kind: str, image: np.ndarray, parameters: list[int]) -> bytes:
    return cv2.imencode(kind, image, parameters)[1].tobytes()
