"""Sequences in TUM layout."""

from collections.abc import Iterator

import numpy as np

from hsslam_node.frame import Frame
from hsslam_node.sources.image_files import BadImageError, read_color, read_depth
from hsslam_node.sources.source import BadFrame, SourceOptions
from hsslam_node.sources.tum_folder import TumFolder
from hsslam_node.sources.undistortion import Undistortion


class TumSource:
    """A TUM sequence: colour and depth associated within 20 ms, both undistorted.

    Stamps are those of the colour images.

    Raises:
        UserError: the folder, its lists or its camera are missing or wrong.
    """

    def __init__(self, name: str, options: SourceOptions) -> None:
        folder = TumFolder.find(name)
        distorted, self.depth_units_per_m = folder.camera()
        self._pairs = [folder.pairs[i] for i in options.selected(len(folder.pairs))]
        self._undistortion = Undistortion(distorted)
        self.name = f"tum:{name}"
        self.camera = distorted.undistorted()
        self.frame_count: int | None = len(self._pairs)
        self.rate_hz = _rate_hz([stamp for stamp, _, _ in self._pairs])

    def frames(self) -> Iterator[Frame | BadFrame]:
        """Every associated pair of images; one that cannot be read comes as a `BadFrame`."""
        for index, (stamp_ns, color_file, depth_file) in enumerate(self._pairs):
            try:
                color = read_color(color_file, self.camera)
                depth = read_depth(depth_file, self.camera)
            except BadImageError as error:
                yield BadFrame(index, stamp_ns, str(error))
                continue
            yield Frame(
                index=index,
                stamp_ns=stamp_ns,
                camera=self.camera,
                color=self._undistortion.color(color),
                depth_raw=self._undistortion.depth(depth),
                depth_units_per_m=self.depth_units_per_m,
            )


def _rate_hz(stamps_ns: list[int]) -> float:
    period_ns = float(np.median(np.diff(stamps_ns))) if len(stamps_ns) > 1 else 0.0
    return 1e9 / period_ns if period_ns > 0 else 30.0
