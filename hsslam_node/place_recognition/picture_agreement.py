"""Whether two frames agree in detail: places that look alike have one shape, but differ in pictures."""

from dataclasses import dataclass

import cv2
import numpy as np

from hsslam_node.frame import Frame
from hsslam_node.geometry.projection import pixel_rays, project
from hsslam_node.geometry.se3 import inverse

_WIDTH_PX = 320  # of the images that are compared, at most
_BLOCK_PX = 20  # at that width; 40 of 640
_SMALLEST_BLOCK_PX = 8
_BLUR_PX = 1.0  # poses are good to about a pixel
_TOLERANCE_M, _TOLERANCE_SLOPE = 0.03, 0.01  # depths agree within first + second z^2, m
_FEWEST = 0.6  # share of a block's pixels that both frames must see
_CONTRAST = 6.0  # standard deviation of grey levels of a block with texture
_ALIKE = 0.7  # correlation of a block that shows the same
_FEWEST_BLOCKS = 20  # compared, in the images of two frames
ALIKE_SHARE = 0.85  # of the blocks; one room: 0.95 to 0.98, rooms that look alike: 0.67 to 0.72


@dataclass(frozen=True)
class PictureAgreement:
    """Numbers of blocks that have texture and show the same surface in both frames."""

    alike: int  # that show the same
    compared: int

    @property
    def differ(self) -> bool:
        """Whether the frames show places that only look alike; False with fewer than 20 blocks."""
        return self.compared >= _FEWEST_BLOCKS and not self.are_alike

    @property
    def are_alike(self) -> bool:
        """Whether 85 % of the compared blocks show the same."""
        return self.alike >= ALIKE_SHARE * self.compared


def picture_agreement(first: Frame, second: Frame, T_first_second: np.ndarray) -> PictureAgreement:
    """Compare the pictures of two frames on the same surface, block by block.

    Whole images correlate well if walls and furniture do; a picture on the wall is only a few blocks.
    """
    grey, depth_m = _small(first)  # [h, w]
    other, other_m = _small(second)
    camera = first.camera.scaled(grey.shape[1] / first.camera.width_px)
    v, u = np.mgrid[: grey.shape[0], : grey.shape[1]]
    points = (pixel_rays(u, v, camera) * depth_m[..., None]).reshape(-1, 3)
    at_u, at_v, z = (
        numbers.reshape(grey.shape) for numbers in project(points, camera, inverse(T_first_second))
    )
    at_u, at_v = at_u.astype(np.float32), at_v.astype(np.float32)
    seen = cv2.remap(other, at_u, at_v, cv2.INTER_LINEAR, borderValue=0)
    seen_m = cv2.remap(other_m, at_u, at_v, cv2.INTER_NEAREST, borderValue=0)
    off_m = np.abs(seen_m - z)
    both = (depth_m > 0) & (seen_m > 0) & (off_m < _TOLERANCE_M + _TOLERANCE_SLOPE * z**2)
    return _compared(_blocks(grey), _blocks(seen), _blocks(both.astype(np.float32)))


def _small(frame: Frame) -> tuple[np.ndarray, np.ndarray]:
    """Blurred grey levels and depth (m) [h, w] float32 of a small image; depth of the nearest pixel."""
    camera = frame.camera
    factor = min(1.0, _WIDTH_PX / camera.width_px)
    size = round(camera.width_px * factor), round(camera.height_px * factor)
    grey = cv2.cvtColor(frame.color, cv2.COLOR_RGB2GRAY)
    grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    depth_m = cv2.resize(frame.depth_m(), size, interpolation=cv2.INTER_NEAREST)
    return cv2.GaussianBlur(grey, (0, 0), _BLUR_PX), depth_m


def _blocks(image: np.ndarray) -> np.ndarray:
    """[blocks, pixels of a block] of an image [h, w], without incomplete blocks at its borders."""
    side = max(round(_BLOCK_PX * image.shape[1] / _WIDTH_PX), _SMALLEST_BLOCK_PX)
    h, w = (length // side for length in image.shape)
    split = image[: h * side, : w * side].reshape(h, side, w, side).swapaxes(1, 2)
    return split.reshape(h * w, -1).astype(np.float64)


def _compared(first: np.ndarray, second: np.ndarray, both: np.ndarray) -> PictureAgreement:
    """Correlations of blocks [n, pixels], over the pixels that both frames see."""
    count = np.maximum(both.sum(axis=1), 1.0)
    a, b = ((x - ((x * both).sum(axis=1) / count)[:, None]) * both for x in (first, second))
    deviation, other = (np.sqrt((x * x).sum(axis=1) / count) for x in (a, b))
    tested = (both.mean(axis=1) >= _FEWEST) & (np.maximum(deviation, other) >= _CONTRAST)
    correlation = (a * b).sum(axis=1) / count / np.maximum(deviation * other, 1e-6)
    return PictureAgreement(int((correlation[tested] >= _ALIKE).sum()), int(tested.sum()))
