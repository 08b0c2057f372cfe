"""One RGB-D frame, which a source yields and the tracker gets. It has no ground truth."""

from dataclasses import dataclass, replace
from numbers import Integral

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera, expect_camera
from hsslam_node.inertial.reading import ImuReading
from hsslam_node.odometry.reading import OdometryReading

_SMALLEST_SIDE_PX = 8  # tracking begins with images of an eighth of the size
_LARGEST_INDEX = 1 << 53  # as in messages: languages that have only doubles hold it exactly
_LARGEST_STAMP_NS = (1 << 63) - 1
_MOST_UNITS_PER_M = 1e9
_NO_DEPTH = 65535  # the largest of 16 bits: nothing was measured, or it is too far for them


@dataclass(frozen=True)
class Frame:
    """A colour image with the planar depth registered to it, both undistorted (`Undistortion` does it).

    Numbers may be of NumPy; the frame has those of Python, as messages need them.

    Raises:
        UserError: an array has another shape or type than listed below, a number is out of range, or the
            camera is no `Camera` or has lens distortion.
    """

    index: int
    stamp_ns: int  # from 0 on, of 64 bits
    camera: Camera
    color: np.ndarray  # [H, W, 3] uint8, RGB
    depth_raw: np.ndarray  # [H, W] uint16, 0 = no measurement; 65535 becomes 0
    depth_units_per_m: float  # depth in metres = depth_raw / depth_units_per_m
    odometry: OdometryReading | None = None  # of the robot's wheels, at the stamp
    imu: ImuReading | None = None  # integrated up to the stamp

    def __post_init__(self) -> None:
        if not (isinstance(self.index, Integral) and 0 <= self.index <= _LARGEST_INDEX):
            raise UserError(f"frame index {self.index}: expected a whole number, 0 to 2^53")
        stamp_ns, units_per_m = self.stamp_ns, self.depth_units_per_m
        if not (isinstance(stamp_ns, Integral) and 0 <= stamp_ns <= _LARGEST_STAMP_NS):
            raise UserError(
                f"frame {self.index}: stamp_ns = {stamp_ns}: expected a whole number, 0 to "
                f"{_LARGEST_STAMP_NS}"
            )
        if expect_camera(f"frame {self.index}: camera", self.camera).has_lens:
            raise UserError(
                f"frame {self.index}: camera.distortion = {list(self.camera.distortion)}: expected none: "
                "undistort the images with Undistortion and give Camera.undistorted()"
            )
        size = (self.camera.height_px, self.camera.width_px)
        _expect("color", self.color, (*size, 3), np.uint8, self.index)
        _expect("depth_raw", self.depth_raw, size, np.uint16, self.index)
        if not (
            isinstance(units_per_m, int | float | np.number)
            and 0 < units_per_m <= _MOST_UNITS_PER_M
        ):
            raise UserError(
                f"frame {self.index}: depth_units_per_m = {units_per_m}: expected more than 0, "
                f"{_MOST_UNITS_PER_M:g} at most"
            )
        object.__setattr__(self, "depth_raw", measured_depth(self.depth_raw))
        object.__setattr__(self, "index", int(self.index))
        object.__setattr__(self, "stamp_ns", int(stamp_ns))
        object.__setattr__(self, "depth_units_per_m", float(units_per_m))

    def copied(self) -> "Frame":
        """The same frame with images of its own, row by row in memory, as kernels are compiled for."""
        color, depth_raw = (np.array(image, order="C") for image in (self.color, self.depth_raw))
        return replace(self, color=color, depth_raw=depth_raw)

    def depth_m(self) -> np.ndarray:
        """Planar depth, [H, W] float32 m, 0 = no measurement."""
        return self.depth_raw * np.float32(1.0 / self.depth_units_per_m)


def measured_depth(depth_raw: np.ndarray) -> np.ndarray:
    """Raw depth [H, W] uint16 with 0 in place of 65535; the same array if that does not occur."""
    if not depth_raw.size or depth_raw.max() < _NO_DEPTH:
        return depth_raw
    return np.where(depth_raw == _NO_DEPTH, np.uint16(0), depth_raw)


def _expect(name: str, array: np.ndarray, shape: tuple[int, ...], dtype: type, index: int) -> None:
    if not isinstance(array, np.ndarray) or isinstance(array, np.ma.MaskedArray):
        raise UserError(
            f"frame {index}: {name} is a {type(array).__name__}: expected a plain NumPy array, "
            f"{np.dtype(dtype)}{list(shape)}"
        )
    if array.shape != shape or array.dtype != dtype:
        raise UserError(
            f"frame {index}: {name} is {array.dtype}{list(array.shape)}: "
            f"expected {np.dtype(dtype)}{list(shape)}"
        )


def expect_trackable(camera: Camera, where: str = "") -> None:
    """Check that images are large enough to track.

    Raises:
        UserError: they are not; the text begins with `where`.
    """
    if min(camera.width_px, camera.height_px) < _SMALLEST_SIDE_PX:
        size = f"{camera.width_px}x{camera.height_px}"
        raise UserError(
            f"{where}images of {size} pixels: expected at least {_SMALLEST_SIDE_PX} a side"
        )
