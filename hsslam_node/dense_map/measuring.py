"""Answers at points: near surfaces from the field, else from what keyframes saw."""

import numpy as np

from hsslam_node.dense_map.answers import MapAnswers
from hsslam_node.dense_map.seen_space import GONE_M, PRIOR_INFORMATION, SeenCells
from hsslam_node.distance.states import FREE
from hsslam_node.kernels.compiled import njit
from hsslam_node.meshing.map_queries import Queries

_LEAST_SLOPE = 1.0  # m/m, of a distance: a flatter field saturates
_ALONE, TRUSTED, _FARTHEST = 0.3, 0.6, 0.95  # of the truncation distance; see `answers_at`
_SAME_M = 0.03  # distances that differ by less are to one surface
_NEAR_M = 0.1  # beyond the truncation; farther from measured surfaces the field does not count


def answers_at(
    points: np.ndarray, queries: Queries, truncation_m: float, seen: SeenCells
) -> MapAnswers:
    """Answers at points [N, 3] float32 m; the field is evaluated near surfaces.

    The field's distance is the SDF over its slope, to first order the way to the surface. A slope below 1
    counts as 1: a saturated field would give too large distances. Up to 0.3 truncations the field counts
    alone. From there to 0.6 it blends into the distance to the surfaces that keyframes measured, unless
    that surface is 3 cm farther and the SDF positive: free space has such an SDF, so it does not count.
    Without a measured distance, as just behind a surface, it counts to 0.95. Its surface does not count
    where keyframes saw free space later.

    Gradients are those of the distance to measured surfaces, which are smoother than the field's. If the
    two distances are not to one surface, they are the field's.
    """
    n, found = len(points), seen.distances.query(points)
    certainty, is_near = np.empty(n, np.float32), np.empty(n, np.bool_)
    first, per_m = np.array(seen.grid.first, np.float64), 1 / seen.grid.voxel_m
    _look_up(points, seen.information, first, per_m, certainty)
    _judge(*found, certainty, np.float32(truncation_m + _NEAR_M), is_near)
    near = np.flatnonzero(is_near)
    field, cells = queries.sdf_and_gradient(points[near]), (seen.distances.states, first, per_m)
    _add_field(points, *field, near, *cells, *found, certainty, np.float32(truncation_m))
    return MapAnswers(*found, certainty)


@njit(cache=True, nogil=True, error_model="numpy")
def _judge(distance, gradient, known, certainty, near_m, is_near):
    """Write which of N points are known and which need the field; gradients get unit length.

    A point is known if a keyframe saw it and it has a distance to a measured surface. A seen point needs
    the field if it has none, as just behind a surface, or `near_m` at most.
    """
    for k in range(distance.shape[0]):
        known[k] = known[k] and certainty[k] > 0 and not np.isnan(distance[k])
        is_near[k] = certainty[k] > 0 and not (known[k] and distance[k] > near_m)
        x, y, z = gradient[k, 0], gradient[k, 1], gradient[k, 2]
        length = np.sqrt(x * x + y * y + z * z)
        scale = np.float32(1.0) / length if known[k] and length > 0 else np.float32(0.0)
        gradient[k, 0], gradient[k, 1], gradient[k, 2] = x * scale, y * scale, z * scale
        if not known[k]:
            distance[k] = np.float32(np.nan)
            if not is_near[k]:
                certainty[k] = np.float32(0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _add_field(
    points,
    sdf,
    slope,
    near,
    states,
    first,
    per_m,
    distance,
    gradient,
    known,
    certainty,
    truncation_m,
):
    """Write or blend in the field's distance [N] m and gradient [N, 3] at points `near` [M] of [N, 3] m.

    Args:
        sdf: [M], in truncations.
        slope: [M, 3] T/m, its derivative.
        states: [X, Y, Z] of cells, `per_m` a metre along each axis; the first one has the numbers `first`.
    """
    one, zero = np.float32(1.0), np.float32(0.0)
    for m in range(near.shape[0]):
        k, s = near[m], abs(sdf[m])
        is_measured = known[k]
        if s >= np.float32(TRUSTED if is_measured else _FARTHEST):
            if not is_measured:
                certainty[k] = zero
            continue
        x, y, z = slope[m, 0], slope[m, 1], slope[m, 2]
        length = np.sqrt(x * x + y * y + z * z)  # T/m
        own_m = sdf[m] * truncation_m / max(length * truncation_m, np.float32(_LEAST_SLOPE))
        beyond_m = distance[k] - own_m  # nan if it is not measured
        if beyond_m >= np.float32(_SAME_M) and sdf[m] > np.float32(_ALONE):
            continue  # free space has such an SDF, too (`weights.free_sdf`)
        if beyond_m > np.float32(GONE_M):
            step = own_m / length if length > 0 else zero
            surface = points[k, 0] - step * x, points[k, 1] - step * y, points[k, 2] - step * z
            if _is_free(surface, states, first, per_m):
                continue
        share = one
        if beyond_m < np.float32(_SAME_M) and s > np.float32(_ALONE):
            share = (np.float32(TRUSTED) - s) / np.float32(TRUSTED - _ALONE)
        distance[k] = own_m if share == one else distance[k] + share * (own_m - distance[k])
        known[k] = True
        if not abs(beyond_m) < np.float32(_SAME_M):
            scale = one / length if length > 0 else zero
            gradient[k, 0], gradient[k, 1], gradient[k, 2] = x * scale, y * scale, z * scale


@njit(cache=True, nogil=True, error_model="numpy")
def _is_free(point, states, first, per_m):
    """Whether the cell of a point (x, y, z) m is FREE."""
    is_inside, i, j, l = _cell(point, first, per_m, states.shape)  # noqa: E741
    return is_inside and states[int(i), int(j), int(l)] == FREE


@njit(cache=True, nogil=True, error_model="numpy")
def _look_up(points, information, first, per_m, certainty):
    """Write the certainty [N] of the cells of points [N, 3]."""
    for k in range(points.shape[0]):
        point = points[k, 0], points[k, 1], points[k, 2]
        is_inside, i, j, l = _cell(point, first, per_m, information.shape)  # noqa: E741
        told = information[int(i), int(j), int(l)] if is_inside else np.float32(0.0)
        certainty[k] = told / (told + PRIOR_INFORMATION)


@njit(cache=True, nogil=True, error_model="numpy")
def _cell(point, first, per_m, shape):
    """Whether a grid of this shape has the cell of a point (x, y, z) m, and its indices there, as floats."""
    i = np.floor(point[0] * per_m) - first[0]
    j = np.floor(point[1] * per_m) - first[1]
    l = np.floor(point[2] * per_m) - first[2]  # noqa: E741
    is_inside = i >= 0 and j >= 0 and l >= 0 and i < shape[0] and j < shape[1] and l < shape[2]
    return is_inside, i, j, l
