"""Errors of distances and gradients at points of observed free space, against a true mesh."""

from collections.abc import Callable
from dataclasses import dataclass

import igl
import numpy as np
import trimesh

from hsslam_node.dense_map.answers import MapAnswers
from hsslam_node.distance.distance_map import DistanceMap, Distances
from hsslam_node.distance.states import FREE
from hsslam_node.geometry.se3 import inverse, transformed

LARGE_M = 0.05  # errors that matter to planners
_NO_GRADIENT_M = 0.1  # so close to the largest distance there is no gradient


@dataclass(frozen=True)
class DistanceErrors:
    """Errors over the points of one kind."""

    points: int
    mean_m: float  # of absolute errors
    within_5cm: float  # share, 0 to 1
    optimistic_5cm: float  # share whose distance is more than 5 cm too large
    pessimistic_5cm: float
    gradient_deg: float  # median angle


@dataclass(frozen=True)
class TrueDistances:
    """Distances of points to the nearest triangle."""

    distance_m: np.ndarray  # [N]
    away: np.ndarray  # [N, 3] unit, from the triangle


def free_points(distances: DistanceMap, count: int, seed: int) -> np.ndarray:
    """Points [N, 3] m, world, uniform in the volume of the free voxels."""
    rng = np.random.default_rng(seed)
    free = np.argwhere(distances.states == FREE)
    indices = free[rng.integers(len(free), size=count)] + rng.uniform(-0.5, 0.5, (count, 3))
    T = inverse(distances.T_grid_world)
    return transformed(T, distances.grid.centres(indices))


def true_distances(
    points: np.ndarray, mesh: trimesh.Trimesh, T_world_mesh: np.ndarray
) -> TrueDistances:
    """Exact distances of points [N, 3] m, world."""
    return measure_from(mesh, T_world_mesh)(points)


def measure_from(
    mesh: trimesh.Trimesh, T_world_mesh: np.ndarray
) -> Callable[[np.ndarray], TrueDistances]:
    """A function that returns the true distances of points [N, 3] m, world."""
    vertices = transformed(T_world_mesh, np.asarray(mesh.vertices))
    faces = np.asarray(mesh.faces, np.int64)
    tree = igl.AABB()
    tree.init(vertices, faces)

    def measure(points: np.ndarray) -> TrueDistances:
        squared, _, nearest = tree.squared_distance(
            vertices, faces, np.ascontiguousarray(points, np.float64)
        )
        distance = np.sqrt(squared)
        away = (points - nearest) / np.maximum(distance, 1e-9)[:, None]
        return TrueDistances(distance, away)

    return measure


def distance_errors(
    found: Distances | MapAnswers, truth: TrueDistances, far_m: float, mask: np.ndarray
) -> DistanceErrors:
    """Errors at the points of a mask [N]; larger distances count as `far_m`, without their gradients."""
    true_m = np.minimum(truth.distance_m, far_m)[mask]
    error = found.distance_m[mask] - true_m
    steep = true_m < far_m - _NO_GRADIENT_M
    gradient = found.gradient[mask][steep]
    gradient = gradient / np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-9)
    cosine = np.einsum("ni,ni->n", gradient, truth.away[mask][steep])
    return DistanceErrors(
        int(mask.sum()),
        float(np.abs(error).mean()),
        float((np.abs(error) < LARGE_M).mean()),
        float((error > LARGE_M).mean()),
        float((error < -LARGE_M).mean()),
        float(np.rad2deg(np.median(np.arccos(np.clip(cosine, -1, 1))))),
    )
