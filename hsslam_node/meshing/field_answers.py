"""What the field says of points; apart as its queries on CPU and GPU give the same."""

from typing import NamedTuple

import numpy as np


class FieldAnswers(NamedTuple):
    """What the field says at points [N, 3]. Outside the bound: sdf 1, gradient 0."""

    sdf: np.ndarray  # [N] float32, in units of the truncation
    gradient: np.ndarray  # [N, 3] float32, of the SDF, 1/m
