"""The pose that odometry reports at the stamp of a frame, and the motion since an earlier one."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.pose_covariance import carried, turned
from hsslam_node.geometry.se3 import inverse, quaternion_from_rotation, transform
from hsslam_node.odometry.noise import USUAL_NOISE, growth, increase, of_jump

_FLOOR = np.diag([1e-4**2] * 6)  # m^2, rad^2: least covariance, also at rest, for errors of stamps
# of a step; within a shorter one, errors of the heading add at most 1 % to the variance of the default noise
_LONG_M = 0.25
_POSITION, _ROTATION = slice(0, 3), slice(3, 6)


@dataclass(frozen=True)
class OdometryReading:
    """Pose of the camera by odometry, in the drifting frame `odom`.

    `numbers` are x, y, z (m) and the unit quaternion xyzw, [7]: the same as on the wire, so that a replay
    computes with the same bits. `covariance` is [6, 6] of translation (m) and of rotation (rad) about the
    camera's centre, in the axes of odom. It grows along the path: its growth between two readings is the
    covariance of the motion between them. None: the motion has the usual noise. `series` is a new number
    each time that odometry or its covariance restarts; the motion from one series to another is unknown.

    Raises:
        UserError: an array has another shape, or a number that is not finite.
    """

    numbers: np.ndarray
    covariance: np.ndarray | None = None
    series: int = 0

    def __post_init__(self) -> None:
        for name, shape in (("numbers", (7,)), ("covariance", (6, 6))):
            array = getattr(self, name)
            if array is not None and not (array.shape == shape and np.isfinite(array).all()):
                numbers = " ".join(f"{number:g}" for number in array.ravel())
                raise UserError(f"odometry: {name} {numbers}: expected finite, of shape {shape}")

    @classmethod
    def at(
        cls, T_odom_cam: np.ndarray, covariance: np.ndarray | None = None, series: int = 0
    ) -> "OdometryReading":
        """The reading of a pose [4, 4]; only the upper half of the covariance [6, 6] counts."""
        if covariance is not None:
            covariance = np.triu(covariance) + np.triu(covariance, 1).T
        q = quaternion_from_rotation(T_odom_cam[:3, :3])
        return cls(np.concatenate([T_odom_cam[:3, 3], q]), covariance, series)

    @property
    def T_odom_cam(self) -> np.ndarray:
        """The pose, [4, 4]."""
        return transform(self.numbers[:3], self.numbers[3:])


@dataclass(frozen=True)
class Motion:
    """The motion from one camera pose to a later one, by odometry."""

    T_from_to: np.ndarray  # [4, 4]
    covariance: np.ndarray  # [6, 6] m, rad; axes of the later camera, rotation about its centre

    def is_surer_than(self, sigma_m: float, sigma_rad: float) -> bool:
        """Whether the largest standard deviations of position and rotation are below these."""
        largest = [np.linalg.eigvalsh(self.covariance[at, at])[-1] for at in (_POSITION, _ROTATION)]
        return bool(largest[0] < sigma_m**2 and largest[1] < sigma_rad**2)


class MotionSince:
    """The motion since a reading, over all readings after it.

    An error of the heading moves all later poses sideways, so the covariance needs each reading in between.
    """

    def __init__(self) -> None:
        self._T_odom_from = np.eye(4)  # where motions begin
        self._newest: OdometryReading | None = None
        self._covariance = np.zeros((6, 6))  # of the newest relative to the first, axes of odom
        self.is_from_reading = False  # whether motions begin at a reading

    def restart(self, reading: OdometryReading | None) -> None:
        """Measure motions from this reading on; None: odometry has no pose here."""
        self._newest = reading
        self._T_odom_from = np.eye(4) if reading is None else reading.T_odom_cam
        self._covariance = np.zeros((6, 6))
        self.is_from_reading = reading is not None

    def begin_later(self, T_from_later: np.ndarray) -> None:
        """Measure motions from a frame without a reading on, T_from_later [4, 4] after where they began so
        far, as the camera saw it. Their covariance stays that since the reading."""
        self._T_odom_from = self._T_odom_from @ T_from_later
        self.is_from_reading = False

    def to(self, reading: OdometryReading | None) -> Motion | None:
        """The motion to this reading; None if there is none, or was none before. May be repeated."""
        if reading is None or self._newest is None:
            return None
        T_newest, T = self._newest.T_odom_cam, reading.T_odom_cam
        step_m = T[:3, 3] - T_newest[:3, 3]
        grown = _grown(self._newest, reading)
        if np.linalg.norm(step_m) > _LONG_M:
            grown = _along(grown, step_m)
        self._covariance = carried(self._covariance, step_m) + grown
        self._newest = reading
        T_from_to = inverse(self._T_odom_from) @ T
        return Motion(T_from_to, turned(self._covariance, T[:3, :3].T) + _FLOOR)


def _along(grown: np.ndarray, step_m: np.ndarray) -> np.ndarray:
    """Covariance [6, 6] of a step [3] without readings in between, along which `grown` [6, 6] came evenly.

    The mean of `grown`, carried over what is left of the step, by Simpson's rule, which is exact here.
    """
    return (grown + 4 * carried(grown, step_m / 2) + carried(grown, step_m)) / 6


def _grown(before: OdometryReading, after: OdometryReading) -> np.ndarray:
    """Covariance [6, 6] of the motion between two readings, axes of odom."""
    if before.series != after.series:
        return of_jump()
    if before.covariance is None or after.covariance is None:
        return growth(before.T_odom_cam, after.T_odom_cam, USUAL_NOISE)
    return increase(before.covariance, after.covariance)
