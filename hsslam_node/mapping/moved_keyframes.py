"""Keyframes whose poses were corrected after the map had learnt them: mapping repeats them first."""

import numpy as np

_MOVED_M, _MOVED_RAD = 1e-3, 1e-3  # less is within what the map resolves
_REPEATS = 8  # draws until the map has followed a keyframe


class MovedKeyframes:
    """Notes where each keyframe stood when it was mapped."""

    def __init__(self) -> None:
        self._mapped_at = np.zeros((0, 4, 4))
        self._due = np.zeros(0, np.int64)  # draws that are outstanding

    def draw(self, poses: np.ndarray, wanted: int, generator: np.random.Generator) -> np.ndarray:
        """At most `wanted` ids of keyframes that have moved, given all poses [n, 4, 4] now."""
        self._follow(poses)
        moved = np.flatnonzero(self._due > 0)
        size = min(wanted, len(moved))
        if size <= 0:
            return np.zeros(0, np.int64)
        drawn = generator.choice(moved, size, replace=False)
        self._due[drawn] -= 1
        return drawn

    def _follow(self, poses: np.ndarray) -> None:
        known = len(self._mapped_at)
        then, now = self._mapped_at, poses[:known]
        shift_m = np.linalg.norm(now[:, :3, 3] - then[:, :3, 3], axis=1)
        # for small angles the matrices are sqrt(2) times the angle apart
        turn_rad = np.linalg.norm(now[:, :3, :3] - then[:, :3, :3], axis=(1, 2)) / np.sqrt(2)
        moved = (shift_m > _MOVED_M) | (turn_rad > _MOVED_RAD)
        self._due[moved] = _REPEATS
        then[moved] = now[moved]
        self._mapped_at = np.concatenate([then, poses[known:]])
        self._due = np.append(self._due, np.zeros(len(poses) - known, np.int64))
