"""Masks of frames of image files: a folder with an image for each colour image, of the same name."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.files.image_files import read_mask
from hsslam_node.user_path import user_path

_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp")


class FrameMasks:
    """Which pixels of each frame have no depth: those that are black in its mask.

    A mask has the pixels of the image file, with its lens distortion.

    Raises:
        UserError: a colour image has no mask.
    """

    def __init__(self, folder: Path, color_files: Sequence[Path]) -> None:
        files = {path.stem: path for path in folder.iterdir() if path.suffix.lower() in _SUFFIXES}
        missing = [path for path in color_files if path.stem not in files]
        if missing:
            raise UserError(
                f"{folder}: {len(missing)} of {len(color_files)} images have no mask: "
                f"expected {folder / missing[0].stem}.png for {missing[0]}"
            )
        self._files = files

    @classmethod
    def found(
        cls, mask: str, beside: Path | None, color_files: Sequence[Path]
    ) -> "FrameMasks | None":
        """Masks of the folder that `--mask` names, else of the folder `beside` the images; None if there is
        none."""
        if mask and user_path(mask).is_dir():
            return cls(user_path(mask), color_files)
        return cls(beside, color_files) if beside is not None and beside.is_dir() else None

    def hidden(self, color_file: Path, camera: Camera) -> np.ndarray:
        """Which pixels of an image are hidden, [H, W] bool; of a coloured mask the brightest channel counts.

        Raises:
            BadImageError: the mask cannot be read, or has another size.
        """
        return read_mask(self._files[color_file.stem], camera)
