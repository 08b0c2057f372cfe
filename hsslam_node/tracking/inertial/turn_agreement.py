"""Whether an IMU turns as the camera does; a file of its own: its mounting may be given wrongly."""

import numpy as np

from hsslam_node.geometry.se3 import so3_log

_MEMORY_S = 10.0
_FIRST_S = 0.5  # until then nothing is known
_SHARE = 0.5  # of the camera's turn rate that may be off
_REST = 0.06  # rad/s that may be off, also at rest: bias, and noise of tracking


class TurnAgreement:
    """Mean squares of the camera's turn rate and of its difference from the IMU's."""

    def __init__(self) -> None:
        self._seconds = 0.0
        self._turn = 0.0  # (rad/s)^2
        self._off = 0.0

    def compare(self, R_by_imu: np.ndarray, R_tracked: np.ndarray, seconds: float) -> None:
        """Take the same turn [3, 3] by both."""
        self._seconds = min(self._seconds + seconds, _MEMORY_S)
        share = min(seconds / self._seconds, 1.0)
        turn = float(np.sum((so3_log(R_tracked) / seconds) ** 2))
        off = float(np.sum((so3_log(R_by_imu.T @ R_tracked) / seconds) ** 2))
        self._turn += share * (turn - self._turn)
        self._off += share * (off - self._off)

    @property
    def is_known(self) -> bool:
        """Whether enough was compared to say."""
        return self._seconds >= _FIRST_S

    @property
    def holds(self) -> bool:
        """Whether what was compared agrees; False if most of the camera's turns are not what the IMU says."""
        return self._off < _SHARE**2 * self._turn + _REST**2
