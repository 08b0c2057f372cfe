"""Intrinsics and depth scale on the command line, for a recording without a camera file."""

import math
from dataclasses import dataclass

from hsslam_node.errors import UserError


@dataclass(frozen=True)
class CameraOptions:
    """Camera of record:FOLDER; overrides its camera.json."""

    fx: float | None = None
    """Focal length along x, pixels."""
    fy: float | None = None
    """Focal length along y, pixels (none: same as fx)."""
    cx: float | None = None
    """Principal point from the centre of the first column, pixels (none: middle)."""
    cy: float | None = None
    """Principal point from the centre of the first row, pixels (none: middle)."""
    distortion: tuple[float, ...] = ()
    """Lens distortion in OpenCV's order: k1 k2 p1 p2 [k3]."""
    depth_scale: float | None = None
    """Depth image units per metre, 1000 for millimetres."""

    def __post_init__(self) -> None:
        for name in ("fx", "fy", "depth_scale"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                option = name.replace("_", "-")
                raise UserError(f"--camera.{option} {value}: expected a number above 0")
        for name in ("cx", "cy"):
            value = getattr(self, name)
            if value is not None and not math.isfinite(value):
                raise UserError(f"--camera.{name} {value}: expected a finite number")
        if len(self.distortion) not in (0, 4, 5) or not all(map(math.isfinite, self.distortion)):
            raise UserError(f"--camera.distortion {self.distortion}: expected k1 k2 p1 p2 [k3]")

    def given(self) -> dict[str, object]:
        """The values that are set, named as in a camera.json."""
        numbers = ("fx", "fy", "cx", "cy", "depth_scale")
        fields: dict[str, object] = {name: getattr(self, name) for name in numbers}
        fields["distortion"] = list(self.distortion) or None
        return {name: value for name, value in fields.items() if value is not None}
