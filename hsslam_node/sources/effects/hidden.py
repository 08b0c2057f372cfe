"""Frames that a mask hides in part, or a covered lens as a whole."""

from dataclasses import replace

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.sources.effects.changed_source import ChangedSource
from hsslam_node.sources.files.image_files import BadImageError, read_mask
from hsslam_node.sources.source import Source
from hsslam_node.user_path import user_path

_MOST_HIDDEN = 0.99  # with less, no frame can be tracked


class Masked(ChangedSource):
    """A source without depth where a mask is black, such as at parts of the robot in view.

    `mask`: an image file of the size of the frames, which have no lens distortion; of a colour image
    the brightest channel counts.

    Raises:
        UserError: the mask cannot be read, has another size, or hides nearly everything.
    """

    def __init__(self, source: Source, mask: str) -> None:
        super().__init__(source, "with a mask")
        try:
            self._is_hidden = read_mask(user_path(mask), source.camera)  # [H, W]
        except BadImageError as error:
            raise UserError(f"--mask {error}") from None
        if (share := float(self._is_hidden.mean())) > _MOST_HIDDEN:
            raise UserError(
                f"--mask {mask}: hides {share:.1%} of the image: expected white pixels where depth counts"
            )

    def changed(self, frame: Frame) -> Frame:
        """The frame, without depth where it is hidden."""
        depth_raw = np.where(self._is_hidden, np.uint16(0), frame.depth_raw)
        return replace(frame, depth_raw=depth_raw)


class Covered(ChangedSource):
    """A source whose lens is covered for some frames: they are black and without depth; odometry stays."""

    def __init__(self, source: Source, first: int, count: int) -> None:
        super().__init__(source, "with a covered lens")
        self._covered = range(first, first + count)

    def changed(self, frame: Frame) -> Frame:
        """The frame, black and without depth if it is covered."""
        if frame.index not in self._covered:
            return frame
        color, depth_raw = np.zeros_like(frame.color), np.zeros_like(frame.depth_raw)
        return replace(frame, color=color, depth_raw=depth_raw)
