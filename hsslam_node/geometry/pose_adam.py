"""Adam over the twist of one pose; a file of its own as bundle adjustment and tracking share it."""

import numpy as np

_BETA2, _EPS = 0.999, 1e-8


class PoseAdam:
    """Turns gradients by a world-side twist into steps for `moved_about_camera`; keeps its moments."""

    def __init__(self, beta1: float) -> None:
        self._beta1 = beta1
        self._first = np.zeros(6)
        self._second = np.zeros(6)
        self._steps = 0

    def step(self, gradient: np.ndarray, rate: float | np.ndarray) -> np.ndarray:
        """The twist [6] (m, rad) to move by; rate: m and rad of a step, one number or [6]."""
        self._steps += 1
        self._first = self._beta1 * self._first + (1 - self._beta1) * gradient
        self._second = _BETA2 * self._second + (1 - _BETA2) * gradient**2
        m = self._first / (1 - self._beta1**self._steps)
        v = self._second / (1 - _BETA2**self._steps)
        return -rate * m / (np.sqrt(v) + _EPS)
