"""Converts an image of ROS, raw or compressed, to colour or depth."""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from hsslam_node.geometry.camera import Camera
from hsslam_node.image_header import PNG_START
from hsslam_node.sources.files.image_files import (
    BadImageError,
    decode_color,
    decode_depth,
    expect_header,
)
from hsslam_node.sources.ros2.compressed_depth import (
    HEADER_BYTES,
    metres_of_inverse,
    rvl_depth,
    rvl_size,
)

FLOAT_UNITS_PER_M = 5000.0  # of depth that comes as metres in floats: up to 13.1 m
_FARTHEST_MEDIAN_M = 100.0  # of depth in floats: more is another unit
MILLIMETRES_PER_M = 1000.0  # of depth in whole numbers, REP 118

_TO_RGB = {
    "rgb8": None,
    "bgr8": cv2.COLOR_BGR2RGB,
    "8UC3": cv2.COLOR_BGR2RGB,
    "rgba8": cv2.COLOR_RGBA2RGB,
    "bgra8": cv2.COLOR_BGRA2RGB,
    "8UC4": cv2.COLOR_BGRA2RGB,
    "mono8": cv2.COLOR_GRAY2RGB,
    "8UC1": cv2.COLOR_GRAY2RGB,
    "yuv422": cv2.COLOR_YUV2RGB_UYVY,
    "uyvy": cv2.COLOR_YUV2RGB_UYVY,
    "yuv422_yuy2": cv2.COLOR_YUV2RGB_YUY2,
    "yuyv": cv2.COLOR_YUV2RGB_YUY2,
    "YUYV": cv2.COLOR_YUV2RGB_YUY2,  # as the RealSense SDK names it
    "bayer_rggb8": cv2.COLOR_BayerRGGB2RGB,
    "bayer_bggr8": cv2.COLOR_BayerBGGR2RGB,
    "bayer_gbrg8": cv2.COLOR_BayerGBRG2RGB,
    "bayer_grbg8": cv2.COLOR_BayerGRBG2RGB,
}
_OF_MOSAIC = {name: code for name, code in _TO_RGB.items() if name.startswith("bayer_")}
_CHANNELS = {
    **dict.fromkeys(("rgb8", "bgr8", "8UC3"), 3),
    **dict.fromkeys(("rgba8", "bgra8", "8UC4"), 4),
    **dict.fromkeys(("yuv422", "uyvy", "yuv422_yuy2", "yuyv", "YUYV"), 2),
}
_GREY = ("mono8", "8UC1")
_DEPTH = ("16UC1", "32FC1", "mono16")
_PNG_DEPTH = ("16UC1", "mono16", "png")  # formats
_MOST_RVL_PX = 2**24  # more than a frame may have
_PNG_BITS = 24  # offset of the bit depth in a PNG; the colour type follows


@dataclass(frozen=True)
class RawImage:
    """A `sensor_msgs/Image`, or with `is_compressed` the file in a `sensor_msgs/CompressedImage`."""

    stamp_ns: int
    encoding: str  # of compressed ones the format, such as "jpeg" or "16UC1; compressedDepth png"
    data: np.ndarray  # [N] uint8
    width_px: int = 0
    height_px: int = 0
    step_bytes: int = 0
    is_big_endian: bool = False
    is_compressed: bool = False
    frame_id: str = ""  # ROS name of the camera's optical frame

    @property
    def nbytes(self) -> int:
        """Bytes of the data."""
        return self.data.nbytes

    @property
    def content(self) -> Literal["color", "grey", "depth", "unknown"]:
        """What it shows, by its encoding; values of 16 bits are depth."""
        if self.is_compressed:
            return self._compressed_content()
        if self.encoding in _DEPTH:
            return "depth"
        if self.encoding in _GREY:
            return "grey"
        return "color" if self.encoding in _TO_RGB else "unknown"

    def color(self) -> np.ndarray:
        """Colour [H, W, 3] uint8 RGB; grey values thrice.

        Raises:
            BadImageError: another encoding, or the data do not fit.
        """
        if self.is_compressed:
            return self._compressed_color()
        if self.encoding == "mono16":
            grey = (self._pixels(np.dtype(np.uint16), 1) >> 8).astype(np.uint8)
            return np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2RGB), np.uint8)
        if self.encoding not in _TO_RGB:
            expected = ", ".join((*_TO_RGB, "mono16"))
            raise BadImageError(f"colour in encoding {self.encoding!r}: expected {expected}")
        image = np.ascontiguousarray(
            self._pixels(np.dtype(np.uint8), _CHANNELS.get(self.encoding, 1))
        )
        code = _TO_RGB[self.encoding]
        if code is None:
            return image
        try:
            return np.asarray(cv2.cvtColor(image, code), np.uint8)
        except cv2.error:
            raise BadImageError(
                f"{self.encoding} of {self.width_px}x{self.height_px} pixels: expected an even width"
            ) from None

    def _compressed_color(self) -> np.ndarray:
        """Colour [H, W, 3] uint8 RGB of a JPEG or PNG, also of one that has the mosaic of a Bayer image."""
        rgb = decode_color(self.data.tobytes(), f"image in format {self.encoding!r}")
        code = _OF_MOSAIC.get(self.encoding.split(";")[0].strip())
        if code is None or not (rgb == rgb[..., :1]).all():
            return rgb
        return np.asarray(cv2.cvtColor(np.ascontiguousarray(rgb[..., 0]), code), np.uint8)

    def depth(self, units_per_m: float | None = None) -> tuple[np.ndarray, float]:
        """Depth [H, W] uint16 (0 = no measurement), and its units per metre.

        units_per_m: of the image; None: those of its encoding.

        Raises:
            BadImageError: another encoding, or the data do not fit.
        """
        if self.is_compressed:
            depth_raw = self._compressed_depth()
            if not self.encoding.startswith("32FC1"):
                return depth_raw, units_per_m or MILLIMETRES_PER_M
            return _depth_of_floats(
                metres_of_inverse(depth_raw, self.data[:HEADER_BYTES]), units_per_m
            )
        if self.encoding in ("16UC1", "mono16"):
            return self._pixels(np.dtype(np.uint16), 1), units_per_m or MILLIMETRES_PER_M
        if self.encoding == "32FC1":
            return _depth_of_floats(self._pixels(np.dtype(np.float32), 1), units_per_m)
        raise BadImageError(
            f"depth in encoding {self.encoding!r}: expected 16UC1 (mm) or 32FC1 (m)"
        )

    def expect_size(self, camera: Camera) -> None:
        """Check the size of a raw image, or of a compressed one by its header, before it is decoded.

        Raises:
            BadImageError: it has not the camera's size.
        """
        if self._is_rvl:
            expect_size("depth in RVL", *rvl_size(self.data), camera)
        elif self.is_compressed:
            start = self._image_start()
            expect_header(self.data[start:].data, f"image in format {self.encoding!r}", camera)
        else:
            expect_size(self.encoding, self.width_px, self.height_px, camera)

    def _compressed_content(self) -> Literal["color", "grey", "depth"]:
        start = self._image_start()
        bits = self.data[start + _PNG_BITS : start + _PNG_BITS + 2].tobytes()
        is_png = self.data[start : start + 4].tobytes() == PNG_START
        if self.encoding.startswith(_DEPTH) or "compressedDepth" in self.encoding:
            return "depth"
        if is_png and bits == b"\x10\0":  # 16 bits, grey
            return "depth"
        return "grey" if self.encoding.startswith(_GREY) else "color"

    @property
    def _is_rvl(self) -> bool:
        return self.is_compressed and self.encoding.endswith("compressedDepth rvl")

    def _image_start(self) -> int:
        """Bytes that image_transport's compressedDepth puts before a PNG: 12 or none."""
        return 12 if self.data[12:16].tobytes() == PNG_START else 0

    def _compressed_depth(self) -> np.ndarray:
        """Depth of a 16-bit PNG, without the 12 bytes that compressedDepth puts before it, or of RVL; inverse
        depth of 32FC1."""
        if self._is_rvl:
            return rvl_depth(self.data, _MOST_RVL_PX)
        data, is_inverse = self.data.tobytes(), self.encoding.startswith("32FC1; compressedDepth")
        if not (is_inverse and self._image_start()) and not self.encoding.startswith(_PNG_DEPTH):
            raise BadImageError(
                f"depth in format {self.encoding!r}: expected a PNG of 16UC1, or compressedDepth"
            )
        return decode_depth(data[self._image_start() :], f"depth in format {self.encoding!r}")

    def _pixels(self, dtype: np.dtype, channels: int) -> np.ndarray:
        """Pixels [H, W] or [H, W, channels], without padding of the rows."""
        row = self.width_px * channels * dtype.itemsize
        size = self.height_px * self.step_bytes
        if row == 0 or self.step_bytes < row or size == 0 or self.data.size < size:
            raise BadImageError(
                f"{self.encoding} of {self.width_px}x{self.height_px} pixels in {self.data.size} bytes, "
                f"{self.step_bytes} a row: expected at least {row} a row"
            )
        rows = self.data[:size].reshape(self.height_px, self.step_bytes)[:, :row]
        order = ">" if self.is_big_endian else "<"
        pixels = np.ascontiguousarray(rows).view(dtype.newbyteorder(order)).astype(dtype)
        return pixels if channels == 1 else pixels.reshape(self.height_px, self.width_px, channels)


def _depth_of_floats(floats: np.ndarray, units_per_m: float | None) -> tuple[np.ndarray, float]:
    """Depth [H, W] uint16 and its units per metre, of floats [H, W]; `units_per_m`: of these, None: metres.

    Raises:
        BadImageError: they have another unit.
    """
    scaled = floats * np.float32(FLOAT_UNITS_PER_M / (units_per_m or 1.0))
    is_there = (scaled > 0) & (scaled < 65535.5)  # not so for NaN and infinity
    _expect_metres(scaled, is_there)
    return np.where(is_there, scaled + 0.5, 0).astype(np.uint16), FLOAT_UNITS_PER_M


def _expect_metres(scaled: np.ndarray, is_there: np.ndarray) -> None:
    """Raise BadImageError if depth in floats, [H, W] in units of `FLOAT_UNITS_PER_M`, has another unit."""
    measured = np.isfinite(scaled) & (scaled > 0)
    if 2 * np.count_nonzero(is_there) >= np.count_nonzero(measured):
        return
    median_m = float(np.median(scaled[measured])) / FLOAT_UNITS_PER_M
    if median_m > _FARTHEST_MEDIAN_M:
        raise BadImageError(
            f"depth in encoding '32FC1' has a median of {median_m:.0f} m: expected metres, or "
            "--camera.depth-scale 1000 for millimetres"
        )


def expect_size(what: str, width_px: int, height_px: int, camera: Camera) -> None:
    """Raise BadImageError unless an image has the camera's size; `what`: the image, for the error."""
    if (width_px, height_px) != (camera.width_px, camera.height_px):
        raise BadImageError(
            f"{what} of {width_px}x{height_px} pixels: expected "
            f"{camera.width_px}x{camera.height_px} as before"
        )
