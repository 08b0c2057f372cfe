"""Distances between a reconstructed and a true surface."""

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import ArrayLike

from hsslam_node.evaluation.mesh.nearest_triangle import nearest_points, parts
from hsslam_node.evaluation.mesh.visibility import Observer, Views

SAMPLES = 200_000
WITHIN_M = 0.05  # of the ratios
_MOST_DRAWS = 10  # times `samples`: gives up if the views saw less than a tenth of a surface


@dataclass(frozen=True)
class MeshMetrics:
    """Accuracy: reconstruction to truth; completion: truth to reconstruction. NaN: nothing seen."""

    accuracy_mean_m: float
    accuracy_median_m: float
    accuracy_ratio_5cm: float  # share of the reconstruction within 5 cm of the truth, 0 to 1
    completion_mean_m: float
    completion_median_m: float
    completion_ratio_5cm: float  # share of the truth within 5 cm of the reconstruction, 0 to 1
    samples: int

    @classmethod
    def of(cls, accuracy_m: np.ndarray, completion_m: np.ndarray) -> "MeshMetrics":
        """From distances of points of the reconstruction [N] and of points of the truth [M]."""
        if len(accuracy_m) == 0 or len(completion_m) == 0:
            nan = float("nan")
            return cls(nan, nan, 0.0, nan, nan, 0.0, 0)
        return cls(
            accuracy_mean_m=float(accuracy_m.mean()),
            accuracy_median_m=float(np.median(accuracy_m)),
            accuracy_ratio_5cm=float((accuracy_m < WITHIN_M).mean()),
            completion_mean_m=float(completion_m.mean()),
            completion_median_m=float(np.median(completion_m)),
            completion_ratio_5cm=float((completion_m < WITHIN_M).mean()),
            samples=min(len(accuracy_m), len(completion_m)),
        )


def compare_meshes(
    reconstruction: trimesh.Trimesh,
    truth: trimesh.Trimesh,
    views: Views | None = None,
    samples: int = SAMPLES,
    seed: int = 0,
) -> MeshMetrics:
    """Distances of `samples` area-uniform, observed points on each surface to the other surface, m.

    Both meshes are in one frame; this aligns nothing. Points that `views` did not see are culled from
    both (points, so triangles may be large). A distance is exact: to the nearest point of the other
    surface if that was observed, else to the nearest of its triangles with an observed sample or centroid.
    """
    ours = sample_surface(reconstruction, samples, seed, views)
    theirs = sample_surface(truth, samples, seed + 1, views)
    if len(ours.points) == 0 or len(theirs.points) == 0:
        return MeshMetrics.of(np.empty(0), np.empty(0))
    return MeshMetrics.of(
        _observed_distances(ours.points, truth, theirs, views),
        _observed_distances(theirs.points, reconstruction, ours, views),
    )


@dataclass(frozen=True)
class SurfaceSamples:
    """Points on a mesh and the triangles that they lie on, in the order of these.

    So neighbours mostly follow each other, and whoever looks for what is near them finds it in the cache.
    """

    points: np.ndarray  # [N, 3] m
    faces: np.ndarray  # [N] rows of the mesh's faces


def sample_surface(
    mesh: trimesh.Trimesh, count: int, seed: int, views: Observer | None = None
) -> SurfaceSamples:
    """Up to `count` observed points, uniform over the area; one seed always gives the same."""
    rng = np.random.default_rng(seed)
    vertices, triangles = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)
    cumulative = np.cumsum(_areas(vertices, triangles))
    points, faces, found = [np.empty((0, 3))], [np.empty(0, np.int64)], 0
    for _ in range(_MOST_DRAWS if len(triangles) and cumulative[-1] > 0 else 0):
        at = rng.random(count) * cumulative[-1]
        order = np.argsort(at)
        rows = np.searchsorted(cumulative, at[order], side="right")
        rows = np.minimum(rows, len(triangles) - 1)
        chosen = vertices[triangles[rows]]  # [count, 3, 3]
        a, b = np.sqrt(rng.random((count, 1)))[order], rng.random((count, 1))[order]
        drawn = (1 - a) * chosen[:, 0] + a * (1 - b) * chosen[:, 1] + a * b * chosen[:, 2]
        seen = views.observed(drawn) if views else np.ones(count, bool)
        as_drawn = np.argsort(order[seen])  # so that the first `count` are a fair choice
        points.append(drawn[seen][as_drawn])
        faces.append(rows[seen][as_drawn])
        found += int(seen.sum())
        if found >= count or not found:
            break
    kept_points, kept_faces = np.concatenate(points)[:count], np.concatenate(faces)[:count]
    by_face = np.argsort(kept_faces, kind="stable")
    return SurfaceSamples(kept_points[by_face], kept_faces[by_face])


def _areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Twice the areas [F] m2 of triangles [F, 3]."""
    found = np.empty(len(faces))
    for rows in parts(len(faces)):
        a, b, c = (vertices[faces[rows, k]] for k in range(3))
        found[rows] = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return found


def distances(points: ArrayLike, vertices: ArrayLike, faces: ArrayLike) -> np.ndarray:
    """Exact distance [N] m of points [N, 3] to the triangles `faces` [F, 3] between vertices [V, 3], m."""
    return nearest_points(points, vertices, faces)[0]


def _observed_distances(
    points: np.ndarray, mesh: trimesh.Trimesh, samples: SurfaceSamples, views: Views | None
) -> np.ndarray:
    """Distances [N] m of points [N, 3] to what the views saw of a mesh, of which `samples` are observed."""
    faces = np.asarray(mesh.faces)
    found, feet = nearest_points(points, mesh.vertices, faces)
    if views is None:
        return found
    hidden = ~views.observed(feet)
    if hidden.any():
        vertices = np.asarray(mesh.vertices, np.float64)
        seen = np.concatenate(
            [views.observed(vertices[faces[rows]].mean(axis=1)) for rows in parts(len(faces))]
        )
        seen[samples.faces] = True
        found[hidden] = distances(points[hidden], mesh.vertices, faces[seen])
    return found
