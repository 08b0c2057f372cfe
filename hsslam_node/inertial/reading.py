"""IMU samples integrated up to the stamp of a frame, and the motion between two such readings."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.se3 import quaternion_from_rotation, rotation_from_quaternion

_LONGEST_S = 0.3  # of a motion between two frames
_UNIT = 1e-3  # largest error of the norm of a quaternion


@dataclass(frozen=True)
class ImuReading:
    """Rotation and velocity by the IMU alone since a series began, in the axes that the camera had then.

    Both drift, and gravity counts as an acceleration upwards. So use only the motion between two readings of
    one series; readings in between may be missing. `numbers`, [8], are the same as on the wire, so that a
    replay computes with the same bits: the unit quaternion xyzw of the camera, the integral of its specific
    force (m/s), and the time since the series began (s). `series` names the series: its first stamp, ns, or
    a later number if the clock was set back.

    Raises:
        UserError: the numbers are not 8, one is not finite, or the quaternion has no unit norm.
    """

    numbers: np.ndarray
    series: int

    def __post_init__(self) -> None:
        numbers = self.numbers
        is_whole = numbers.shape == (8,) and np.isfinite(numbers).all()
        if not is_whole or abs(np.linalg.norm(numbers[:4]) - 1) > _UNIT:
            text = " ".join(f"{number:g}" for number in numbers.ravel())
            raise UserError(
                f"imu {text}: expected 8 finite numbers: unit qx qy qz qw, vx vy vz, seconds"
            )

    @classmethod
    def at(cls, R: np.ndarray, velocity: np.ndarray, seconds: float, series: int) -> "ImuReading":
        """The reading of a rotation [3, 3], a velocity [3] m/s and a time."""
        q = quaternion_from_rotation(R)
        return cls(np.concatenate([q, velocity, [seconds]]), series)

    @property
    def rotation(self) -> np.ndarray:
        """[3, 3] from the axes of the camera to those of the series."""
        return rotation_from_quaternion(self.numbers[:4])

    @property
    def velocity(self) -> np.ndarray:
        """[3] m/s, axes of the series; at rest it grows by 9.81 m/s each second, upwards."""
        return self.numbers[4:7]

    @property
    def seconds(self) -> float:
        """Time since the series began."""
        return float(self.numbers[7])


@dataclass(frozen=True)
class InertialMotion:
    """The motion of a camera between two frames by its IMU, without any correction."""

    rotation: np.ndarray  # [3, 3] from the later camera's axes to the earlier one's
    velocity_change: np.ndarray  # [3] m/s, integral of the specific force; later camera's axes
    seconds: float

    @property
    def is_short(self) -> bool:
        """Whether there is no long gap between the frames, so that bias and gravity can be learnt."""
        return 0 < self.seconds < _LONGEST_S


def motion_between(before: ImuReading | None, after: ImuReading | None) -> InertialMotion | None:
    """The motion between two readings; None without one of them, or if they are of different series.

    The motion from a reading to itself is none, in 0 s.
    """
    if before is None or after is None or before.series != after.series:
        return None
    seconds = after.seconds - before.seconds
    if seconds < 0:
        return None
    R = after.rotation
    change = R.T @ (after.velocity - before.velocity)
    return InertialMotion(before.rotation.T @ R, change, seconds)
