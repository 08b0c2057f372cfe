"""Whether odometry or an IMU moves like the camera; a file of its own, as both ask for it."""

import numpy as np

_MEMORY_S = 10.0
_FIRST_S = 0.5  # time to compare before there is an answer
_SHARE = 0.5  # of the camera's motion by which the sensor may differ


class MotionAgreement:
    """Mean squares of the camera's speed or turn rate, and of its difference from the sensor's.

    Args:
        rest: [n] m/s or rad/s by which the sensor may differ, also at rest: its noise, and that of tracking.
    """

    def __init__(self, *rest: float) -> None:
        self._rest = np.array(rest)
        self._seconds = 0.0
        self._moved = np.zeros(len(rest))  # (m/s)^2 or (rad/s)^2
        self._off = np.zeros(len(rest))

    def compare(self, moved: np.ndarray, off: np.ndarray, seconds: float) -> None:
        """Take a tracked motion and its difference from the sensor's, both [n] m or rad.

        It is ignored if it took no time: stamps of a camera may repeat or go back.
        """
        if seconds <= 0:
            return
        self._seconds = min(self._seconds + seconds, _MEMORY_S)
        share = min(seconds / self._seconds, 1.0)
        self._moved += share * ((moved / seconds) ** 2 - self._moved)
        self._off += share * ((off / seconds) ** 2 - self._off)

    @property
    def is_known(self) -> bool:
        """Whether enough time was compared."""
        return self._seconds >= _FIRST_S

    @property
    def holds(self) -> bool:
        """Whether the sensor differs by less than half of the camera's motion, plus noise."""
        return bool((self._off < _SHARE**2 * self._moved + self._rest**2).all())
