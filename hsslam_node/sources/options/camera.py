"""Options of cameras: lens, depth scale, and which RealSense to open."""

import math
from dataclasses import dataclass

from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import LensModel, expect_lens
from hsslam_node.sources.options.limits import expect_range


@dataclass(frozen=True)
class CameraOptions:
    """Camera of record: and 7scenes:, overrides their camera.json; bag: and ros2: read only depth_scale."""

    fx: float | None = None
    """Focal length along x, pixels."""
    fy: float | None = None
    """Focal length along y, pixels (none: same as fx)."""
    cx: float | None = None
    """Principal point from the centre of the first column, pixels (none: middle)."""
    cy: float | None = None
    """Principal point from the centre of the first row, pixels (none: middle)."""
    distortion: tuple[float, ...] = ()
    """Lens distortion in OpenCV's order: 4, 5, 8, 12 or 14 numbers (equidistant: 4)."""
    distortion_model: LensModel | None = None
    """Lens model of these numbers (none: opencv)."""
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
        if self.distortion:
            expect_lens("--camera.distortion", self.distortion, self.distortion_model or "opencv")

    def given(self) -> dict[str, object]:
        """The values that are set, or follow from those, named as in a camera.json."""
        numbers = ("fx", "fy", "cx", "cy", "depth_scale")
        fields: dict[str, object] = {name: getattr(self, name) for name in numbers}
        fields["distortion"] = list(self.distortion) or None
        fields["fy"] = self.fy or self.fx
        fields["distortion_model"] = self.distortion_model or (
            "opencv" if self.distortion else None
        )
        return {name: value for name, value in fields.items() if value is not None}


@dataclass(frozen=True)
class RealsenseOptions:
    """Camera of source realsense."""

    serial: str = ""
    """Serial number (empty: the first camera found)."""
    width_px: int = 640
    """Image width, pixels."""
    height_px: int = 480
    """Image height, pixels."""
    rate_hz: int = 30
    """Frame rate, Hz."""

    def __post_init__(self) -> None:
        expect_range("realsense.width-px", self.width_px, 160, 1920)
        expect_range("realsense.height-px", self.height_px, 120, 1440)
        expect_range("realsense.rate-hz", self.rate_hz, 1, 90)
