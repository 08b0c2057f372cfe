"""Decodes images: PNG with our reader if it can, else with OpenCV's; alone, as all sources share it."""

import cv2
import numpy as np

from hsslam_node.png.decode import decode_png

# ignores the orientation in EXIF: camera matrix and depth belong to the pixels as stored
_NOT_TURNED = cv2.IMREAD_IGNORE_ORIENTATION
Packed = bytes | memoryview | np.ndarray  # [bytes] uint8


def decoded_rgb(data: Packed) -> np.ndarray | None:
    """Colour [H, W, 3] uint8 RGB of an image in any format; None if it cannot be decoded."""
    image = decode_png(data)
    if image is not None and image.ndim == 3:
        return image
    bgr = _by_opencv(data, cv2.IMREAD_COLOR | _NOT_TURNED)
    return None if bgr is None else cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB, dst=bgr)


def decoded_as_stored(data: Packed) -> np.ndarray | None:
    """Pixels as stored, such as depth [H, W] uint16, or BGR; None if they cannot be decoded."""
    image = decode_png(data)
    if image is not None and image.ndim == 2:
        return image
    return _by_opencv(data, cv2.IMREAD_UNCHANGED)


def decoded_mask(data: Packed) -> np.ndarray | None:
    """BGR [H, W, 3] uint8, or uint16 if the image has 16 bits; None if it cannot be decoded."""
    return _by_opencv(data, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH | _NOT_TURNED)


def _by_opencv(data: Packed, flags: int) -> np.ndarray | None:
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error:
        return None
