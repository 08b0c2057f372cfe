"""Results of a query of the field; apart as the queries on CPU and GPU share it."""

from typing import NamedTuple

import numpy as np


class FieldAnswers(NamedTuple):
    """The field at points [N, 3]. Outside the bound: sdf 1, gradient 0."""

    sdf: np.ndarray  # [N] float32, in units of the truncation
    gradient: np.ndarray  # [N, 3] float32, of the SDF, 1/m
