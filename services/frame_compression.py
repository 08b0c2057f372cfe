"""Frames made small for the log and the viewer."""

import cv2
import msgspec
import numpy as np

from hsslam_node.proto.frame_codec import depth_image
from hsslam_node.proto.messages import Frame

_JPEG = [cv2.IMWRITE_JPEG_QUALITY, 90]
# run lengths of horizontal differences: 3.9 ms and 122 kB for a Kinect frame, where the default search
# for repeats takes 5.5 ms for 131 kB
_PNG = [
    *(cv2.IMWRITE_PNG_COMPRESSION, 1),
    *(cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_SUB),
    *(cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE),
]


def compress_frame(frame: Frame) -> Frame:
    """The frame with colour as JPEG (quality 90) and depth as lossless 16-bit PNG."""
    return msgspec.structs.replace(
        frame,
        color=memoryview(jpeg(frame)),
        color_encoding="jpeg",
        depth=memoryview(_png(frame)),
        depth_encoding="png",
    )


def jpeg(frame: Frame) -> bytes:
    """Colour as JPEG; one that comes as JPEG is passed on."""
    if frame.color_encoding == "jpeg":
        return bytes(frame.color)
    rgb = np.frombuffer(frame.color, np.uint8).reshape(frame.height_px, frame.width_px, 3)
    return _encode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), _JPEG)


def _png(frame: Frame) -> bytes:
    if frame.depth_encoding == "png":
        return bytes(frame.depth)
    return _encode(".png", depth_image(frame), _PNG)


def _encode(kind: str, image: np.ndarray, parameters: list[int]) -> bytes:
    return cv2.imencode(kind, image, parameters)[1].tobytes()
