"""Colour and depth images from files, on the real-time path: one read, one decode, no copy."""

import errno
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from hsslam_node.errors import STORAGE_FAILS, UserError
from hsslam_node.geometry.camera import Camera
from hsslam_node.image_decoding import decoded_as_stored, decoded_mask, decoded_rgb
from hsslam_node.image_header import LARGEST_PIXELS, has_end, image_header

_MAY_PASS = (*STORAGE_FAILS, errno.EMFILE, errno.ENFILE, errno.ENOMEM)
_WAITS_S = (0.5, 1.0, 2.0, 4.0)  # between tries


class BadImageError(Exception):
    """An image file that is missing, truncated or not as expected; the text is one line."""


class UnreadImageError(BadImageError):
    """The disk or its network fails, for seconds: the image itself may be good."""


class DiskFailures:
    """Ends a search for an image that can be read, if the disk fails twice: each try takes 7.5 s."""

    def __init__(self) -> None:
        self._has_failed = False

    def take(self, error: BadImageError) -> None:
        """Take in why an image cannot be read.

        Raises:
            UserError: the disk fails for the second time.
        """
        if not isinstance(error, UnreadImageError):
            return
        if self._has_failed:
            raise UserError(f"{error}: expected a disk that can be read") from None
        self._has_failed = True


def read_color(path: Path, camera: Camera) -> np.ndarray:
    """Colour image [H, W, 3] uint8 RGB.

    Raises:
        BadImageError: missing, truncated, or of another size than the camera.
    """
    image = decode_color(_read(path), str(path), camera)
    _expect_size(path, image, camera)
    return image


def read_any_color(path: Path) -> np.ndarray:
    """Colour image [H, W, 3] uint8 RGB, whatever its size; raises as `read_color`."""
    return decode_color(_read(path), str(path))


def read_mask(path: Path, camera: Camera) -> np.ndarray:
    """Where a mask is black, [H, W] bool; of a coloured one the brightest channel counts, alpha does not.

    Raises:
        BadImageError: missing, truncated, or of another size than the camera.
    """
    data = _read(path)
    _expect_whole(data, str(path), camera)
    image = _expect_decoded(decoded_mask(data), str(path))
    _expect_size(path, image, camera)
    return image.max(axis=2) == 0


def decode_color(data: bytes | np.ndarray, name: str, camera: Camera | None = None) -> np.ndarray:
    """As `read_color`, from memory; `name`: for errors."""
    _expect_whole(data, name, camera)
    return _expect_decoded(decoded_rgb(data), name)


def read_depth(path: Path, camera: Camera) -> np.ndarray:
    """Depth image [H, W] uint16, as stored.

    Raises:
        BadImageError: missing, truncated, not 16 bit, or of another size than the camera.
    """
    image = decode_depth(_read(path), str(path), camera)
    _expect_size(path, image, camera)
    return image


def read_any_depth(path: Path) -> np.ndarray:
    """Depth image [H, W] uint16, whatever its size; raises as `read_depth`."""
    return decode_depth(_read(path), str(path))


def decode_depth(data: bytes | np.ndarray, name: str, camera: Camera | None = None) -> np.ndarray:
    """As `read_depth`, from memory; `name`: for errors."""
    _expect_whole(data, name, camera)
    image = _expect_decoded(decoded_as_stored(data), name)
    if image.dtype != np.uint16 or image.ndim != 2:
        channels = 1 if image.ndim == 2 else image.shape[2]
        raise BadImageError(
            f"{name}: {8 * image.itemsize} bit, {channels} channels: expected 16 bit, 1 channel"
        )
    return image


def expect_header(data: bytes | memoryview, name: str, camera: Camera | None = None) -> None:
    """Check the header of a PNG or JPEG before it is decoded; other formats pass.

    Raises:
        BadImageError: too many pixels for any image, or neither the camera's size nor that size turned.
    """
    header = image_header(data)
    if header is None:
        return
    size = header.width_px, header.height_px
    found = f"{name}: {size[0]}x{size[1]} pixels"
    if not 0 < header.pixels <= LARGEST_PIXELS:
        raise BadImageError(f"{found}: expected at most {LARGEST_PIXELS} in all")
    if camera is not None and set(size) != {camera.width_px, camera.height_px}:
        raise BadImageError(f"{found}: expected {camera.width_px}x{camera.height_px}")


def _read(path: Path) -> bytes:
    return read_with_patience(path.read_bytes, str(path))


def read_with_patience(read: Callable[[], bytes], name: str) -> bytes:
    """What `read` returns; tries again for 7.5 s if the disk or its network fails.

    Raises:
        BadImageError: it cannot be read; UnreadImageError if the disk or its network fails all the time.
    """
    waits_s = iter(_WAITS_S)
    while True:
        try:
            return read()
        except OSError as error:
            may_pass = error.errno in _MAY_PASS
            if may_pass and (wait_s := next(waits_s, None)) is not None:
                time.sleep(wait_s)
                continue
            kind = UnreadImageError if may_pass else BadImageError
            raise kind(f"{name}: {error.strerror or 'cannot be read'}") from None


def _expect_whole(data: bytes | np.ndarray, name: str, camera: Camera | None) -> None:
    """BadImageError if the file is empty or cut short, or its header is not what was expected."""
    if len(data) == 0:
        raise BadImageError(f"{name}: empty file")
    view = np.frombuffer(data, np.uint8).data
    expect_header(view, name, camera)
    # libjpeg fills what is missing with grey and calls it a success, so look for the end marker.
    if not has_end(view):
        raise BadImageError(f"{name}: truncated at {len(data)} bytes")


def _expect_decoded(image: np.ndarray | None, name: str) -> np.ndarray:
    if image is None:
        raise BadImageError(f"{name}: not an image that can be decoded")
    return image


def _expect_size(path: Path, image: np.ndarray, camera: Camera) -> None:
    height, width = image.shape[:2]
    if (width, height) != (camera.width_px, camera.height_px):
        raise BadImageError(
            f"{path}: {width}x{height} pixels: expected {camera.width_px}x{camera.height_px}"
        )
