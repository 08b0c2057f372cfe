"""Moves depth images into the image of a colour camera that sits beside the depth camera."""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from hsslam_node.frame import measured_depth
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.files.undistortion import Undistortion, resampled_depth

_MILLIMETRES_PER_M = 1000.0  # of whole numbers in cv2.registerDepth
_OUTSIDE_PX = -1e4
_LARGEST = 65535.0  # of uint16


@dataclass(frozen=True, eq=False)
class DepthMounting:
    """A depth camera beside a colour camera."""

    camera: Camera  # of depth, with its distortion
    T_color_depth: np.ndarray  # [4, 4], metres


class DepthRegistration:
    """Depth of each pixel of a colour camera without distortion, from images of a depth camera.

    `cv2.registerDepth` moves each depth pixel into the colour image, the nearest one in front, and closes
    gaps between them, in a colour image that is not finer than depth: there they are small. So each colour
    pixel gets the depth of a whole depth pixel near it. A second look improves it: the colour pixel at that
    depth is a place in the depth image, between four pixels; the depth there, by `resampled_depth`, is that
    of the colour pixel.
    """

    def __init__(
        self, depth: Camera, color: Camera, T_color_depth: np.ndarray, units_per_m: float
    ) -> None:
        """`units_per_m`: of the images; T_color_depth: [4, 4], metres."""
        self._undistortion = Undistortion(depth)
        self._K_depth = depth.K
        size = color.width_px, color.height_px
        # The first look has pixels `step` times as large as those of colour. Its image is at least as large
        # as that of depth, because cv2.registerDepth writes outside of a smaller one.
        steps = max(1.0, color.fx / depth.fx), max(1.0, color.fy / depth.fy)
        coarse = [math.ceil(n / step) for n, step in zip(size, steps, strict=True)]
        self._coarse_size = max(coarse[0], depth.width_px), max(coarse[1], depth.height_px)
        self._K_coarse = _with_larger_pixels(color.K, steps)
        self._columns, self._rows = (
            np.minimum(((np.arange(n) + 0.5) / step).astype(np.intp), last - 1)
            for n, step, last in zip(size, steps, coarse, strict=True)
        )
        # cv2.registerDepth takes whole numbers as millimetres, and the pose in metres.
        self._T_color_depth = T_color_depth.astype(np.float64).copy()
        self._T_color_depth[:3, 3] *= units_per_m / _MILLIMETRES_PER_M
        # A colour pixel with depth z is at (rays + move / z) in the depth image, homogeneous.
        columns, rows = np.meshgrid(*(np.arange(n, dtype=np.float64) for n in size))
        pixels = np.stack([columns, rows, np.ones_like(columns)]).reshape(3, -1)
        T_depth_color = np.linalg.inv(T_color_depth)
        rays = self._K_depth @ T_depth_color[:3, :3] @ np.linalg.inv(color.K) @ pixels
        self._rays = rays.astype(np.float32).reshape(3, *columns.shape)  # [3, H, W]
        self._move = (units_per_m * self._K_depth @ T_depth_color[:3, 3]).astype(np.float32)
        # z in the colour camera of depth d at a place p of the depth image: (turn . p) d + lift
        turn = T_color_depth[2, :3] @ np.linalg.inv(self._K_depth)
        self._turn, self._lift = (
            turn.astype(np.float32),
            np.float32(units_per_m * T_color_depth[2, 3]),
        )

    def registered(self, image: np.ndarray) -> np.ndarray:
        """Depth [H, W] uint16 of the colour camera; 0 where the depth camera measures nothing.

        Raises:
            UserError: the image has another size than the depth camera.
        """
        image = self._undistortion.depth(measured_depth(image))
        coarse = cv2.registerDepth(
            self._K_depth, self._K_coarse, np.zeros(4), self._T_color_depth, image, self._coarse_size,
            depthDilation=True,
        )  # fmt: skip
        x, y = self._places(coarse[self._rows[:, None], self._columns])
        smooth = cv2.convertMaps(x, y, cv2.CV_16SC2)
        nearest, _ = cv2.convertMaps(x, y, cv2.CV_16SC2, nninterpolation=True)
        seen = resampled_depth(image, smooth, nearest).astype(np.float32)
        z = (self._turn[0] * x + self._turn[1] * y + self._turn[2]) * seen + self._lift
        is_seen = (seen > 0) & (z > 0)
        return np.where(is_seen, np.rint(np.minimum(z, _LARGEST)), 0).astype(np.uint16)

    def _places(self, depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Column and row [H, W] float32 in the depth image of pixels with this depth; outside of it for 0."""
        is_there = depth > 0
        inverse = np.divide(1, depth, out=np.zeros(depth.shape, np.float32), where=is_there)
        across, down, ahead = (r + m * inverse for r, m in zip(self._rays, self._move, strict=True))
        is_there &= ahead > 0
        ahead[~is_there] = 1
        across /= ahead
        down /= ahead
        across[~is_there] = down[~is_there] = _OUTSIDE_PX
        return across, down


def _with_larger_pixels(K: np.ndarray, steps: tuple[float, float]) -> np.ndarray:
    """K of the same image with pixels that are `steps` as wide and as high."""
    K = K.copy()
    for axis, step in enumerate(steps):
        K[axis, axis] /= step
        K[axis, 2] = (K[axis, 2] + 0.5) / step - 0.5
    return K
