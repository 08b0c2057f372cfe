"""The nearest point on a mesh, exact, in memory that does not grow with the mesh.

A tree over all triangles takes 0.3 kB for each. Here a tree holds a part of them; only points that may be
nearer to it than to the parts before query it.
"""

from collections.abc import Iterator

import igl
import numpy as np
from numpy.typing import ArrayLike

FACES_AT_ONCE = 2_000_000  # 0.6 GB


def nearest_points(
    points: ArrayLike, vertices: ArrayLike, faces: ArrayLike, at_once: int = FACES_AT_ONCE
) -> tuple[np.ndarray, np.ndarray]:
    """Distances [N] m of points [N, 3] to the triangles `faces` [F, 3] between vertices [V, 3] m, and the
    nearest points [N, 3]; inf and 0 without a triangle."""
    asked, corners = np.asarray(points, np.float64), np.asarray(vertices, np.float64)
    triangles = np.asarray(faces, np.int64)
    squared, feet = np.full(len(asked), np.inf), np.zeros((len(asked), 3))
    for rows in parts(len(triangles), at_once):
        part = triangles[rows]
        near = np.flatnonzero(_squared_to_box(asked, corners[part.ravel()]) < squared)
        if len(near) == 0:
            continue
        tree = igl.AABB()
        tree.init(corners, part)
        found, _, places = map(np.asarray, tree.squared_distance(corners, part, asked[near]))
        is_nearer = found < squared[near]
        squared[near[is_nearer]], feet[near[is_nearer]] = found[is_nearer], places[is_nearer]
    return np.sqrt(squared), feet


def parts(count: int, at_once: int = FACES_AT_ONCE) -> Iterator[slice]:
    """Slices of `at_once` rows or fewer that cover `count` rows, in order."""
    for first in range(0, count, at_once):
        yield slice(first, first + at_once)


def _squared_to_box(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Squared distances [N] m2 of points [N, 3] to the box about corners [M, 3]; 0 inside."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    outside = np.maximum(np.maximum(low - points, points - high), 0.0)
    return np.einsum("nk,nk->n", outside, outside)
