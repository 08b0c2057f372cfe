"""The pinhole camera, and the lens models that OpenCV can undistort."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Integral
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from hsslam_node.errors import UserError

FAR_OFF_CENTRE = 0.12  # of width or height: intrinsics of another image size or camera
_LARGEST_PX, _LARGEST_COEFFICIENT = 1e6, 1e4  # more is no camera
_SAME_PX = 1.0  # focal lengths and centres of one camera
_SAME_SCALE = 1e-6  # relative: some cameras report seven digits of a depth scale
LensModel = Literal["opencv", "equidistant"]
_LENSES: dict[str, tuple[tuple[int, ...], str]] = {  # numbers of coefficients, and their names
    "opencv": ((0, 4, 5, 8, 12, 14), "k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tx ty"),
    "equidistant": ((4,), "k1 k2 k3 k4"),
}


def expect_lens(field: str, distortion: Sequence[float], model: str = "opencv") -> None:
    """Checks the number of lens coefficients of a model, and that they are as small as those of lenses.

    Raises:
        UserError: names the field, its value, and what the model expects.
    """
    if model not in _LENSES:
        raise UserError(f"{field}_model = {model!r}: expected {' or '.join(_LENSES)}")
    counts, names = _LENSES[model]
    is_small = all(abs(number) <= _LARGEST_COEFFICIENT for number in distortion)  # none is nan
    if len(distortion) not in counts or not is_small:
        expected = " or ".join(map(str, counts))
        raise UserError(
            f"{field} = {list(distortion)} ({len(distortion)} numbers): expected {expected} numbers up to "
            f"{_LARGEST_COEFFICIENT:g} of lens model {model}, {names}"
        )


def _coefficients(distortion: ArrayLike | None) -> tuple[float, ...]:
    """The numbers of a lens in one row; OpenCV gives them as [1, n] or [n, 1], and None for none.

    Raises:
        UserError: not numbers.
    """
    try:
        return tuple(np.asarray(() if distortion is None else distortion, float).ravel().tolist())
    except (TypeError, ValueError):
        raise UserError(f"camera.distortion = {distortion!r:.80}: expected numbers") from None


@dataclass(frozen=True)
class Camera:
    """A pinhole camera, OpenCV axes (x right, y down, z forward); pixel centres at integers.

    `distortion` is OpenCV's (k1, k2, p1, p2[, k3[, k4, k5, k6[, s1, s2, s3, s4[, tx, ty]]]]), or with
    the model "equidistant" (k1, k2, k3, k4) of its fisheye lenses. Frames on the bus are already
    undistorted and carry `()`. Numbers may be of NumPy, and the coefficients an array as OpenCV's calibration
    returns; the camera has those of Python, as messages need them.

    Raises:
        UserError: a size or focal length is not positive, a number is not finite or absurdly large or no
            number, or the lens model has another number of coefficients.
    """

    width_px: int
    height_px: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    distortion_model: LensModel = "opencv"

    def __post_init__(self) -> None:
        for name in ("fx", "fy", "cx", "cy"):
            value = getattr(self, name)
            is_number = isinstance(value, int | float | np.number)
            if not is_number or not abs(value) <= _LARGEST_PX:  # also if it is nan
                raise UserError(f"camera.{name} = {value}: expected at most {_LARGEST_PX:g} pixels")
            object.__setattr__(self, name, float(value))
        for name in ("width_px", "height_px"):
            value = getattr(self, name)
            if not isinstance(value, Integral):
                raise UserError(f"camera.{name} = {value}: expected a whole number of pixels")
            object.__setattr__(self, name, int(value))
        for name in ("width_px", "height_px", "fx", "fy"):
            value = getattr(self, name)
            if value <= 0:
                raise UserError(f"camera.{name} = {value}: expected a positive number of pixels")
        object.__setattr__(self, "distortion", _coefficients(self.distortion))
        expect_lens("camera.distortion", self.distortion, self.distortion_model)

    @property
    def K(self) -> np.ndarray:
        """Intrinsic matrix, [3, 3] float64."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def off_centre(self) -> tuple[float, float]:
        """Offset of the principal point from the middle, as shares of width and height."""
        x, y = (self.cx + 0.5) / self.width_px, (self.cy + 0.5) / self.height_px
        return x - 0.5, y - 0.5

    @property
    def has_lens(self) -> bool:
        """Whether images of this camera differ from those of a pinhole camera."""
        return self.distortion_model != "opencv" or any(self.distortion)

    def undistorted(self) -> "Camera":
        """The same camera without lens distortion (what `cv2.undistort` with this K leaves)."""
        return replace(self, distortion=(), distortion_model="opencv")

    def differs_in(self, other: "Camera") -> tuple[str, str, str] | None:
        """The first difference of two cameras: name, value here, value there; None: they are the same.

        The name is "size" or a field such as "camera.fx". Fields may differ by a pixel.
        """
        here, there = (f"{c.width_px} x {c.height_px} px" for c in (self, other))
        if here != there:
            return "size", here, there
        for name in ("fx", "fy", "cx", "cy"):
            value, expected = getattr(self, name), getattr(other, name)
            if abs(value - expected) > _SAME_PX:
                return f"camera.{name}", f"{value:.2f}", f"{expected:.2f}"
        return None

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
            distortion_model=self.distortion_model,
        )


def expect_camera(name: str, value: object) -> Camera:
    """The value.

    Raises:
        UserError: it is no `Camera`, but the matrix K for example.
    """
    if not isinstance(value, Camera):
        raise UserError(f"{name} is a {type(value).__name__}: expected a Camera")
    return value


class HasCamera(Protocol):
    """A frame, a source or the keyframes of a map."""

    @property
    def camera(self) -> Camera: ...
    @property
    def depth_units_per_m(self) -> float: ...


def same_depth_scale(one: float, other: float) -> bool:
    """Whether two depth scales, units per metre, are the same."""
    return math.isclose(one, other, rel_tol=_SAME_SCALE)


def camera_difference(here: HasCamera, expected: HasCamera) -> str:
    """The first difference of depth scales or cameras, with both values; "": none."""
    if not same_depth_scale(here.depth_units_per_m, expected.depth_units_per_m):
        return f"depth_units_per_m {here.depth_units_per_m}: expected {expected.depth_units_per_m}"
    if differs := here.camera.differs_in(expected.camera):
        name, value, wanted = differs
        return f"{name} {value}: expected {wanted}"
    return ""
