"""Removes lens distortion from colour and from depth."""

import cv2
import numpy as np

from hsslam_node.geometry.camera import Camera


class Undistortion:
    """Maps images of a distorted camera to the pinhole camera with the same K.

    Colour is interpolated bilinearly. Depth takes the nearest pixel: a mean over a depth edge is a
    surface that does not exist. What no source pixel covers becomes 0. A camera without distortion
    gets its images back untouched.
    """

    def __init__(self, camera: Camera) -> None:
        self._identity = not camera.has_lens
        if self._identity:
            return
        map_x, map_y = _maps(camera)
        # Fixed-point tables: several times as fast as float maps, 1/32 px steps.
        self._color_maps = cv2.convertMaps(map_x, map_y, cv2.CV_16SC2)
        nearest, _ = cv2.convertMaps(map_x, map_y, cv2.CV_16SC2, nninterpolation=True)
        self._depth_map = nearest

    def color(self, image: np.ndarray) -> np.ndarray:
        """Colour [H, W, 3] uint8 without distortion."""
        if self._identity:
            return image
        return cv2.remap(image, *self._color_maps, cv2.INTER_LINEAR)

    def depth(self, image: np.ndarray) -> np.ndarray:
        """Depth [H, W] uint16 without distortion."""
        if self._identity:
            return image
        return cv2.remap(image, self._depth_map, None, cv2.INTER_NEAREST)  # type: ignore[call-overload]


def _maps(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Column and row [H, W] float32 of the lens's image for each pixel of the pinhole's."""
    size = (camera.width_px, camera.height_px)
    lens = np.array(camera.distortion)
    if camera.distortion_model == "equidistant":
        return cv2.fisheye.initUndistortRectifyMap(
            camera.K, lens, np.eye(3), camera.K, size, cv2.CV_32FC1
        )
    return cv2.initUndistortRectifyMap(camera.K, lens, np.eye(3), camera.K, size, cv2.CV_32FC1)
