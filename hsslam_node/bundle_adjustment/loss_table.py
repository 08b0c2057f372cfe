"""How badly each keyframe is rendered, and which ones the next round takes."""

import numpy as np

from hsslam_node.config import BundleAdjustmentConfig


class LossTable:
    """Last known loss of every keyframe (paper III-C), with a rest for those just refined."""

    def __init__(self, config: BundleAdjustmentConfig) -> None:
        self._config = config
        self._loss = np.zeros(0)
        self._rests_until = np.zeros(0, np.int64)
        self._round = 0

    def update(self, keyframes: np.ndarray, losses: np.ndarray) -> None:
        """Note new losses [n] of keyframes [n]; keyframes that were never measured have none (nan)."""
        grown = int(keyframes.max(initial=-1)) + 1 - len(self._loss)
        if grown > 0:
            self._loss = np.append(self._loss, np.full(grown, np.nan))
            self._rests_until = np.append(self._rests_until, np.zeros(grown, np.int64))
        self._loss[keyframes] = losses

    def select(self) -> np.ndarray:
        """Begin a round: ids of the top N keyframes whose loss exceeds the threshold, worst first."""
        self._round += 1
        loss = np.where(self._rests_until >= self._round, np.nan, self._loss)
        candidates = np.flatnonzero(loss > self._config.loss_threshold)
        worst = candidates[np.argsort(-loss[candidates], kind="stable")]
        return worst[: self._config.top_keyframes]

    def rest(self, keyframes: np.ndarray) -> None:
        """Keep refined keyframes out of the next rounds."""
        self._rests_until[keyframes] = self._round + self._config.cooldown_rounds

    def mean(self, keyframes: np.ndarray) -> float:
        """Mean loss of these keyframes."""
        return float(np.mean(self._loss[keyframes]))
