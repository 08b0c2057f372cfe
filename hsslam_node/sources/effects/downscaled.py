"""Smaller images."""

from dataclasses import replace

import cv2
import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.sources.effects.changed_source import ChangedSource
from hsslam_node.sources.source import Source

_ONE_SURFACE = 0.05  # depths of one surface differ by less than this share


class Downscaled(ChangedSource):
    """A source whose images are `factor` times smaller along each side.

    Colour is averaged over the area of a pixel. Depth is not, since a mean across an edge lies on
    neither surface: a pixel has the measurement at its centre. If the factor is even, the centre is
    between four measurements: those of one surface give their mean inverse depth, which is linear on
    a plane, others the upper left one.

    Raises:
        UserError: the size of the images is not a multiple of the factor.
    """

    def __init__(self, source: Source, factor: int) -> None:
        camera = source.camera
        if camera.width_px % factor or camera.height_px % factor:
            raise UserError(
                f"--downscale {factor}: images are {camera.width_px}x{camera.height_px}: "
                "expected a factor that divides both sides"
            )
        super().__init__(source, f"at 1/{factor} size")
        self._factor = factor
        self.camera = camera.scaled(1.0 / factor)

    def changed(self, frame: Frame) -> Frame:
        """The frame, smaller."""
        size = (self.camera.width_px, self.camera.height_px)
        color = cv2.resize(frame.color, size, interpolation=cv2.INTER_AREA)
        depth_raw = _depth_at_centers(frame.depth_raw, self._factor)
        return replace(
            frame, camera=self.camera, color=np.asarray(color, np.uint8), depth_raw=depth_raw
        )


def _depth_at_centers(depth_raw: np.ndarray, factor: int) -> np.ndarray:
    """Depth [h, w] uint16 at the centres of blocks of factor x factor pixels of [H, W]."""
    first = (factor - 1) // 2
    nearest = np.ascontiguousarray(depth_raw[first::factor, first::factor])
    if factor % 2:
        return nearest
    offsets = (first, first + 1)
    four = np.stack([depth_raw[v::factor, u::factor] for v in offsets for u in offsets])
    low, high = four.min(axis=0), four.max(axis=0)
    is_one_surface = (low > 0) & (high - low < _ONE_SURFACE * high)
    inverse = (1.0 / np.maximum(four, 1, dtype=np.float32)).sum(axis=0)  # [h, w]
    return np.where(is_one_surface, np.rint(4.0 / inverse).astype(np.uint16), nearest)
