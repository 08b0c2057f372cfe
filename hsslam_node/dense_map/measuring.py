"""Measures places: the field's distance in metres, and what keyframes know of the place."""

import numpy as np
from numba import njit

from hsslam_node.dense_map.answers import MapAnswers
from hsslam_node.dense_map.seen_space import PRIOR_INFORMATION, SeenCells
from hsslam_node.meshing.field_answers import FieldAnswers

_LEAST_SLOPE = 1.0  # m/m, of a distance: where the field is flatter it saturates
_FARTHEST = 0.95  # of the truncation: what lies farther away has no distance in the field


def answers_of_field(
    points: np.ndarray, field: FieldAnswers, truncation_m: float, seen: SeenCells
) -> MapAnswers:
    """Answers at points [N, 3] float32 m; takes the arrays of `field` over.

    Near a surface the distance is the SDF over its slope, to first order the way to the surface; a slope
    below 1 counts as 1, or distances would be too large where the field saturates. Farther away the
    distance is the truncation, and has no gradient.
    """
    distance_m, gradient = field.sdf, field.gradient
    known, certainty = np.empty(len(points), np.bool_), np.empty(len(points), np.float32)
    _look_up(points, *_lattice(seen), known, certainty)
    _measure(distance_m, gradient, known, np.float32(truncation_m))
    return MapAnswers(distance_m, gradient, known, certainty)


def _lattice(seen: SeenCells) -> tuple[np.ndarray, np.ndarray, float]:
    return seen.information, np.array(seen.grid.first, np.float64), 1 / seen.grid.voxel_m


@njit(cache=True, fastmath={"contract", "arcp", "reassoc"}, nogil=True, error_model="numpy")
def _measure(sdf, gradient, known, truncation_m):
    """SDF [N] in truncations to metres, gradient [N, 3] (T/m) to unit length, in place."""
    for k in range(sdf.shape[0]):
        if not known[k]:
            sdf[k] = np.float32(np.nan)
            gradient[k] = np.float32(0.0)
            continue
        x, y, z = gradient[k, 0], gradient[k, 1], gradient[k, 2]
        length = np.sqrt(x * x + y * y + z * z)
        slope = length * truncation_m  # m/m
        scale = np.float32(0.0)
        if abs(sdf[k]) > np.float32(_FARTHEST):
            sdf[k] *= truncation_m
        else:
            sdf[k] *= truncation_m / max(slope, np.float32(_LEAST_SLOPE))
            if length > np.float32(0.0):
                scale = np.float32(1.0) / length
        gradient[k, 0], gradient[k, 1], gradient[k, 2] = x * scale, y * scale, z * scale


@njit(cache=True, nogil=True, error_model="numpy")
def _look_up(points, information, first, per_m, known, certainty):
    nx, ny, nz = information.shape
    for k in range(points.shape[0]):
        i = np.floor(points[k, 0] * per_m) - first[0]
        j = np.floor(points[k, 1] * per_m) - first[1]
        l = np.floor(points[k, 2] * per_m) - first[2]  # noqa: E741
        told = np.float32(0.0)
        if i >= 0 and j >= 0 and l >= 0 and i < nx and j < ny and l < nz:
            told = information[int(i), int(j), int(l)]
        known[k] = told > 0
        certainty[k] = told / (told + PRIOR_INFORMATION)
