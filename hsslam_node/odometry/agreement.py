"""Whether odometry moves like the camera; a wrong mounting, unit or wheel size shows here."""

import numpy as np

from hsslam_node.geometry.se3 import inverse, so3_log

_MEMORY_S = 10.0
_FIRST_S = 0.5  # time to compare before there is an answer
_SHARE = 0.5  # of the camera's speed and turn rate by which odometry may differ
_REST = np.array([0.1, 0.1])  # m/s, rad/s by which it may differ, also at rest: noise, late stamps


class OdometryAgreement:
    """Mean squares of the camera's speed and turn rate, and of their differences from odometry's."""

    def __init__(self) -> None:
        self._seconds = 0.0
        self._moved = np.zeros(2)  # (m/s)^2, (rad/s)^2
        self._off = np.zeros(2)

    def compare(self, T_by_odometry: np.ndarray, T_tracked: np.ndarray, seconds: float) -> None:
        """Take a motion [4, 4], later to earlier camera, by odometry and by tracking."""
        self._seconds = min(self._seconds + seconds, _MEMORY_S)
        share = min(seconds / self._seconds, 1.0)
        T_off = inverse(T_by_odometry) @ T_tracked
        self._moved += share * (_rates(T_tracked, seconds) ** 2 - self._moved)
        self._off += share * (_rates(T_off, seconds) ** 2 - self._off)

    @property
    def is_known(self) -> bool:
        """Whether enough time was compared."""
        return self._seconds >= _FIRST_S

    @property
    def holds(self) -> bool:
        """Whether odometry differs by less than half of the camera's motion, plus noise."""
        return bool((self._off < _SHARE**2 * self._moved + _REST**2).all())


def _rates(T: np.ndarray, seconds: float) -> np.ndarray:
    """Speed in m/s and turn rate in rad/s of a motion [4, 4], [2]."""
    return np.array([np.linalg.norm(T[:3, 3]), np.linalg.norm(so3_log(T[:3, :3]))]) / seconds
