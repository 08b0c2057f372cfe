"""What a gyroscope reads at rest, learnt from tracked rotations; of its own: gravity needs none of it."""

import numpy as np

from hsslam_node.geometry.se3 import so3_exp, so3_log
from hsslam_node.inertial.reading import InertialMotion

_MEMORY_S = 20.0  # the mean is of about so long: biases change with temperature, in minutes
_LARGEST = 0.1  # rad/s, that one motion may be off the mean: more is an error of tracking
_MOST = 0.1  # rad/s, of a bias: what is more is not that, but other axes


class GyroBias:
    """The mean of what the gyroscope turned more than the camera did. `value`: [3] rad/s, camera axes."""

    def __init__(self) -> None:
        self.value = np.zeros(3)
        self._seconds = 0.0

    def learn(self, motion: InertialMotion, R_before_after: np.ndarray) -> None:
        """From the motion between two frames and the tracked rotation [3, 3] of it."""
        if not motion.is_short:
            return
        excess = so3_log(R_before_after.T @ motion.rotation) / motion.seconds
        off = excess - self.value
        off *= min(1.0, _LARGEST / (np.linalg.norm(off) + 1e-12))
        self._seconds = min(self._seconds + motion.seconds, _MEMORY_S)
        value = self.value + motion.seconds / self._seconds * off
        self.value = value * min(1.0, _MOST / (np.linalg.norm(value) + 1e-12))

    def removed(self, motion: InertialMotion) -> np.ndarray:
        """The rotation [3, 3] of a short motion without the bias."""
        return motion.rotation @ so3_exp(-motion.seconds * self.value)
