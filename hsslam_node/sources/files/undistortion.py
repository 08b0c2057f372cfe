"""Removes lens distortion from colour and from depth."""

from collections.abc import Sequence

import cv2
import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera

_SAME_SURFACE = 0.02  # of the depth: neighbours that differ by more may lie on two surfaces
_WINDOW = np.ones((2, 2), np.uint8)


class Undistortion:
    """Maps images of a distorted camera to the pinhole camera with the same K.

    Colour is interpolated bilinearly, depth as in `resampled_depth`. Outside of the source image, depth is 0
    and colour that of the border: a black border, which does not move, holds poses back. Images of a
    camera without distortion stay as they are.
    """

    def __init__(self, camera: Camera) -> None:
        self._size = camera.height_px, camera.width_px
        self._identity = not camera.has_lens
        if self._identity:
            return
        map_x, map_y = _maps(camera)
        # Fixed-point tables: several times as fast as float maps, 1/32 px steps.
        self._maps = cv2.convertMaps(map_x, map_y, cv2.CV_16SC2)
        self._nearest, _ = cv2.convertMaps(map_x, map_y, cv2.CV_16SC2, nninterpolation=True)

    def color(self, image: np.ndarray) -> np.ndarray:
        """Colour [H, W, 3] uint8 without distortion; UserError if it has another size than the camera."""
        self._expect_size("colour", image)
        if self._identity:
            return image
        return cv2.remap(image, *self._maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)

    def depth(self, image: np.ndarray) -> np.ndarray:
        """Depth [H, W] uint16 without distortion; UserError if it has another size than the camera."""
        self._expect_size("depth", image)
        return image if self._identity else resampled_depth(image, self._maps, self._nearest)

    def _expect_size(self, name: str, image: np.ndarray) -> None:
        """Maps that are made for another size would crop the image."""
        if image.shape[:2] != self._size:
            found, expected = (f"{w} x {h} px" for h, w in (image.shape[:2], self._size))
            raise UserError(f"{name} has {found}: expected {expected}, the size of its camera")


def resampled_depth(
    depth: np.ndarray, maps: Sequence[np.ndarray], nearest: np.ndarray
) -> np.ndarray:
    """Depth [h, w] uint16 at the places of maps of cv2.convertMaps, [H, W] uint16; 0 outside.

    The inverse of depth, which is linear on a plane, is interpolated between four pixels of one surface.
    Elsewhere the nearest pixel counts: a mean over a depth edge is a surface that does not exist.

    Args:
        depth: of the image that the maps point into.
        maps: for bilinear interpolation.
        nearest: the same for the nearest pixel.
    """
    out = _take(depth, nearest)
    whole, fraction = maps
    between = cv2.remap(_inverse(depth), whole, fraction, cv2.INTER_LINEAR)
    is_one = _take(_is_one_surface(depth), whole) > 0
    np.copyto(out, np.rint(_inverse(between)), where=is_one, casting="unsafe")
    return out


def _take(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """The pixels [H, W, 2] of an image; 0 outside of it."""
    return cv2.remap(image, pixels, None, cv2.INTER_NEAREST)  # type: ignore[call-overload]


def _inverse(depth: np.ndarray) -> np.ndarray:
    """1 / depth, float32; 0 for 0."""
    depth = depth.astype(np.float32)
    return np.divide(1.0, depth, out=np.zeros_like(depth), where=depth > 0)


def _is_one_surface(depth: np.ndarray) -> np.ndarray:
    """[H, W] uint8: 1 if a pixel and its neighbours to the right, below and between may be of one surface."""
    nearest = cv2.erode(depth, _WINDOW, anchor=(0, 0))
    farthest = cv2.dilate(depth, _WINDOW, anchor=(0, 0))
    is_one = (farthest - nearest < _SAME_SURFACE * nearest.astype(np.float32)).astype(np.uint8)
    is_one[-1] = is_one[:, -1] = 0
    return is_one


def _maps(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Column and row [H, W] float32 of the lens's image for each pixel of the pinhole's."""
    size = (camera.width_px, camera.height_px)
    lens = np.array(camera.distortion)
    if camera.distortion_model == "equidistant":
        return cv2.fisheye.initUndistortRectifyMap(
            camera.K, lens, np.eye(3), camera.K, size, cv2.CV_32FC1
        )
    return cv2.initUndistortRectifyMap(camera.K, lens, np.eye(3), camera.K, size, cv2.CV_32FC1)
