"""What a map answers; apart from what computes it, as clients of a service need no kernels."""

from typing import NamedTuple

import numpy as np


class MapAnswers(NamedTuple):
    """Answers for points [N, 3]."""

    distance_m: np.ndarray  # [N] float32 to the nearest surface, negative behind it; nan: unknown
    gradient: np.ndarray  # [N, 3] float32, of the distance: of unit length, or 0 where it has none
    known: np.ndarray  # [N] bool: a keyframe saw the place, as free or as surface
    certainty: np.ndarray  # [N] float32, 0 to 1; `certainty_of` says how


class RayHits(NamedTuple):
    """Where rays [N] end."""

    distance_m: np.ndarray  # [N] float64; inf without a hit
    hit: np.ndarray  # [N] bool: a surface that a keyframe saw, within reach
