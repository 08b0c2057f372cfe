"""The pinhole camera."""

import math
from dataclasses import dataclass, replace

import numpy as np

from hsslam_node.errors import UserError


@dataclass(frozen=True)
class Camera:
    """A pinhole camera, OpenCV axes (x right, y down, z forward); pixel centres at integers.

    `distortion` is OpenCV's (k1, k2, p1, p2[, k3]); frames on the bus are already undistorted and
    carry `()`.

    Raises:
        UserError: a size or focal length is not positive, or a number is not finite.
    """

    width_px: int
    height_px: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name in ("fx", "fy", "cx", "cy"):
            value = getattr(self, name)
            if not math.isfinite(value):
                raise UserError(f"camera.{name} = {value}: expected a finite number of pixels")
        for name in ("width_px", "height_px", "fx", "fy"):
            value = getattr(self, name)
            if value <= 0:
                raise UserError(f"camera.{name} = {value}: expected a positive number of pixels")
        if len(self.distortion) not in (0, 4, 5) or not all(map(math.isfinite, self.distortion)):
            raise UserError(
                f"camera.distortion = {self.distortion}: expected (), or k1 k2 p1 p2 [k3], finite"
            )

    @property
    def K(self) -> np.ndarray:
        """Intrinsic matrix, [3, 3] float64."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def undistorted(self) -> "Camera":
        """The same camera without lens distortion (what `cv2.undistort` with this K leaves)."""
        return replace(self, distortion=())

    def scaled(self, factor: float) -> "Camera":
        """The camera of the image resized by `factor`, pixel centres at integers on both sides."""
        return Camera(
            width_px=round(self.width_px * factor),
            height_px=round(self.height_px * factor),
            fx=self.fx * factor,
            fy=self.fy * factor,
            cx=(self.cx + 0.5) * factor - 0.5,
            cy=(self.cy + 0.5) * factor - 0.5,
            distortion=self.distortion,
        )
