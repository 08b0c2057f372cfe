"""Distances by the field near surfaces, by the distance transform elsewhere."""

from collections.abc import Callable

import numpy as np

from hsslam_node.distance.distance_map import DistanceMap, Distances

QuerySdf = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""points [N, 3] float32 m, world -> signed distance [N] and its gradient [N, 3] per m, in truncations."""

_NEAR = 0.5  # truncations from the surface: nearer the field answers alone
_FAR = 1.0  # truncations from the surface: farther it does not count
_SURE, _SATURATED = 0.75, 0.95  # of the field's largest value, where it stops to be a distance
_STEEP, _FLAT = 0.6, 0.3  # m/m, slopes of a distance and of what is none


class RefinedDistances:
    """Answers as `DistanceMap.query` does, with the field's own distance where there is surface nearby.

    The field's distance is its value over its slope. It counts less the farther the surface, the
    larger the field's value and the flatter its slope, so distances have no step where it ends.

    Args:
        distances: of the same world as the field.
        query: the field, as `MapQueries.sdf_and_gradient`.
        truncation_m: of the field, m.
    """

    def __init__(self, distances: DistanceMap, query: QuerySdf, truncation_m: float) -> None:
        self.distances = distances
        self._query = query
        self._truncation_m = truncation_m

    def query(self, points: np.ndarray) -> Distances:
        """Distances and gradients at points [N, 3] m, world."""
        points = np.ascontiguousarray(points, np.float32)
        found = self.distances.query(points)
        near = np.flatnonzero(np.abs(found.distance_m) < _FAR * self._truncation_m)
        if len(near) == 0:
            return found
        sdf, gradient = self._query(points[near])
        gradient_m = gradient * np.float32(self._truncation_m)  # m/m
        slope = np.linalg.norm(gradient_m, axis=1)
        share = _fading(np.abs(found.distance_m[near]) / self._truncation_m, _NEAR, _FAR)
        share *= _fading(np.abs(sdf), _SURE, _SATURATED) * _fading(-slope, -_STEEP, -_FLAT)
        slope = np.maximum(slope, _FLAT)
        own_m = sdf * self._truncation_m / slope
        rest = 1 - share
        found.distance_m[near] = share * own_m + rest * found.distance_m[near]
        found.gradient[near] = (
            share[:, None] * gradient_m / slope[:, None] + rest[:, None] * found.gradient[near]
        )
        return found


def _fading(value: np.ndarray, full: float, none: float) -> np.ndarray:
    """1 up to `full`, 0 from `none` on, linear between."""
    return np.clip((none - value) / (none - full), 0, 1).astype(np.float32)
