"""Frames at a whole fraction of their size."""

from dataclasses import replace

import cv2
import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.sources.changed_source import ChangedSource
from hsslam_node.sources.source import Source


class Downscaled(ChangedSource):
    """A source whose images are `factor` times smaller along each side.

    Colour is averaged over the area of a pixel. Depth is not, since a mean across an edge lies on
    neither surface: a pixel keeps the measurement nearest to its centre.

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
        first = (self._factor - 1) // 2
        depth = np.ascontiguousarray(frame.depth_raw[first :: self._factor, first :: self._factor])
        return replace(
            frame, camera=self.camera, color=np.asarray(color, np.uint8), depth_raw=depth
        )
