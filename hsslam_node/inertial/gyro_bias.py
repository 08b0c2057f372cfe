"""The gyroscope's bias, learnt from tracked rotations; a file of its own, as gravity does not need it."""

import numpy as np

from hsslam_node.geometry.se3 import so3_exp, so3_log
from hsslam_node.inertial.reading import InertialMotion

_MEMORY_S = 20.0  # length of the mean: biases change with temperature, in minutes
_LARGEST = 0.1  # rad/s, largest difference of a motion from the mean; more is a tracking error
_MOST = 0.1  # rad/s, largest bias; more means that the IMU's axes are wrong


class GyroBias:
    """Mean of the gyroscope's turn rate minus the camera's. `value`: [3] rad/s, camera axes."""

    def __init__(self) -> None:
        self.value = np.zeros(3)
        self._seconds = 0.0

    def learn(self, motion: InertialMotion, R_before_after: np.ndarray) -> None:
        """Learn from the motion between two frames by the IMU, and the tracked rotation [3, 3] of it."""
        if not motion.is_short:
            return
        excess = so3_log(R_before_after.T @ motion.rotation) / motion.seconds
        off = excess - self.value
        off *= min(1.0, _LARGEST / (np.linalg.norm(off) + 1e-12))
        self._add(off, motion.seconds)

    def take_over(self, newer: "GyroBias") -> None:
        """Learn what another mean of the same gyroscope has learnt since."""
        if newer._seconds > 0:
            self._add(newer.value - self.value, newer._seconds)

    def _add(self, off: np.ndarray, seconds: float) -> None:
        self._seconds = min(self._seconds + seconds, _MEMORY_S)
        value = self.value + seconds / self._seconds * off
        self.value = value * min(1.0, _MOST / (np.linalg.norm(value) + 1e-12))

    def removed(self, motion: InertialMotion) -> np.ndarray:
        """The rotation [3, 3] of a short motion without the bias."""
        return motion.rotation @ so3_exp(-motion.seconds * self.value)
