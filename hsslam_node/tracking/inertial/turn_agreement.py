"""Whether the IMU rotates like the camera; a file of its own, as it checks how the IMU is mounted."""

import numpy as np

from hsslam_node.geometry.se3 import so3_log

_MEMORY_S = 10.0
_FIRST_S = 0.5  # time to compare before there is an answer
_SHARE = 0.5  # of the camera's turn rate by which the IMU may differ
_REST = 0.06  # rad/s by which the IMU may differ, also at rest: bias, and noise of tracking


class TurnAgreement:
    """Mean squares of the camera's turn rate and of its difference from the IMU's."""

    def __init__(self) -> None:
        self._seconds = 0.0
        self._turn = 0.0  # (rad/s)^2
        self._off = 0.0

    def compare(self, R_by_imu: np.ndarray, R_tracked: np.ndarray, seconds: float) -> None:
        """Take a rotation [3, 3] by the IMU and by tracking."""
        self._seconds = min(self._seconds + seconds, _MEMORY_S)
        share = min(seconds / self._seconds, 1.0)
        turn = float(np.sum((so3_log(R_tracked) / seconds) ** 2))
        off = float(np.sum((so3_log(R_by_imu.T @ R_tracked) / seconds) ** 2))
        self._turn += share * (turn - self._turn)
        self._off += share * (off - self._off)

    @property
    def is_known(self) -> bool:
        """Whether enough time was compared."""
        return self._seconds >= _FIRST_S

    @property
    def holds(self) -> bool:
        """Whether the IMU's turn rate differs from the camera's by less than half of it, plus noise."""
        return self._off < _SHARE**2 * self._turn + _REST**2
