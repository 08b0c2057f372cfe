"""Answers of a map; apart from the kernels, which clients of a service do not need."""

from typing import NamedTuple

import numpy as np


class MapAnswers(NamedTuple):
    """Answers for points [N, 3]."""

    distance_m: np.ndarray  # [N] float32 to the nearest surface, negative behind it; nan: unknown
    gradient: np.ndarray  # [N, 3] float32, of the distance: unit length, or 0 if there is none
    known: np.ndarray  # [N] bool: a keyframe saw the place, as free or as surface
    certainty: np.ndarray  # [N] float32, 0 to 1; see `certainty_of`


class RayHits(NamedTuple):
    """Where rays [N] end."""

    distance_m: np.ndarray  # [N] float64; inf without a hit
    hit: np.ndarray  # [N] bool: within `max_m`, a surface that a keyframe saw and that is not gone
