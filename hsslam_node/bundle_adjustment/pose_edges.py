"""Measured relative poses between keyframes: the edges of a pose graph."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class PoseEdge:
    """Where keyframe `second` is seen from keyframe `first`."""

    first: int
    second: int
    T_first_second: np.ndarray  # [4, 4]
    information: np.ndarray  # [6, 6] inverse covariance of (m, rad) in the camera frame of `second`
    switchable: bool  # whether it may be wrong altogether, as a loop closure may


@dataclass(frozen=True)
class PoseEdges:
    """m edges as arrays."""

    first: np.ndarray  # [m] int64
    second: np.ndarray  # [m] int64
    T_first_second: np.ndarray  # [m, 4, 4]
    information: np.ndarray  # [m, 6, 6]
    switchable: np.ndarray  # [m] bool

    @classmethod
    def of(cls, edges: Sequence[PoseEdge]) -> "PoseEdges":
        """Stack single edges."""
        return cls(
            np.array([e.first for e in edges], np.int64),
            np.array([e.second for e in edges], np.int64),
            np.array([e.T_first_second for e in edges]).reshape(-1, 4, 4),
            np.array([e.information for e in edges]).reshape(-1, 6, 6),
            np.array([e.switchable for e in edges], bool),
        )
