"""A folder of frames, `npz:FOLDER`: camera.json, and a .npz for each frame with stamp_ns, color and depth."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from hsslam_node.errors import UserError, one_line
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.source import BadFrame


class NpzSource:
    """Frames in the order of their names; color [H, W, 3] uint8 RGB, depth [H, W] uint16, undistorted.

    camera.json has width_px, height_px, fx, fy, cx, cy (px), rate_hz and depth_units_per_m.

    Raises:
        UserError: there are no frames, or camera.json is missing or wrong.
    """

    def __init__(self, name: str, options: SourceOptions) -> None:
        self.name = f"npz:{name}"
        folder = Path(name).expanduser()
        files = sorted(folder.glob("*.npz"))
        if not files:
            raise UserError(f"source {self.name}: no .npz: expected a folder of frames")
        told = _camera_file(folder / "camera.json")
        self.rate_hz = told.pop("rate_hz") / options.stride
        self.depth_units_per_m = told.pop("depth_units_per_m")
        self.camera = Camera(**told)
        self._files = [files[row] for row in options.selected(len(files))]
        self.frame_count: int | None = len(self._files)

    def frames(self, first: int = 0) -> Iterator[Frame | BadFrame]:
        """Every frame; a `BadFrame` for one that cannot be read, and the run goes on."""
        for index, file in enumerate(self._files[first:], first):
            try:
                with np.load(file) as arrays:
                    yield Frame(
                        index=index,
                        stamp_ns=int(arrays["stamp_ns"]),
                        camera=self.camera,
                        color=arrays["color"],
                        depth_raw=arrays["depth"],
                        depth_units_per_m=self.depth_units_per_m,
                    )
            except Exception as error:  # NumPy, zipfile and zlib raise errors of many types
                yield BadFrame(index, 0, f"{file}: {one_line(error)}")


def _camera_file(path: Path) -> dict:
    names = ("width_px", "height_px", "fx", "fy", "cx", "cy", "rate_hz", "depth_units_per_m")
    try:
        told = json.loads(path.read_text())
        return {name: told[name] for name in names}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(f"{path}: {error}: expected {', '.join(names)}") from None
