"""Distances between a reconstructed and a true surface."""

from dataclasses import dataclass

import igl
import numpy as np
import trimesh
from numpy.typing import ArrayLike

from hsslam_node.evaluation.mesh.visibility import Views

SAMPLES = 200_000
_MOST_DRAWS = 10  # times `samples`: gives up on a surface of which the views saw less than a tenth


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


def compare_meshes(
    reconstruction: trimesh.Trimesh,
    truth: trimesh.Trimesh,
    views: Views | None = None,
    samples: int = SAMPLES,
    seed: int = 0,
) -> MeshMetrics:
    """Distances of `samples` area-uniform, observed points on each surface to the other surface, m.

    Both meshes in one frame; nothing is aligned here. What `views` did not see is culled from both
    (by sample, so large triangles are no matter). Distances are exact, to the triangles of the other
    surface that have an observed sample or centroid.
    """
    ours = sample_surface(reconstruction, samples, seed, views)
    theirs = sample_surface(truth, samples, seed + 1, views)
    if len(ours.points) == 0 or len(theirs.points) == 0:
        nan = float("nan")
        return MeshMetrics(nan, nan, 0.0, nan, nan, 0.0, 0)
    accuracy = distances(ours.points, truth.vertices, _observed_faces(theirs, truth, views))
    completion = distances(
        theirs.points, reconstruction.vertices, _observed_faces(ours, reconstruction, views)
    )
    return MeshMetrics(
        accuracy_mean_m=float(accuracy.mean()),
        accuracy_median_m=float(np.median(accuracy)),
        accuracy_ratio_5cm=float((accuracy < 0.05).mean()),
        completion_mean_m=float(completion.mean()),
        completion_median_m=float(np.median(completion)),
        completion_ratio_5cm=float((completion < 0.05).mean()),
        samples=min(len(ours.points), len(theirs.points)),
    )


@dataclass(frozen=True)
class SurfaceSamples:
    """Points on a mesh and the triangles that they lie on."""

    points: np.ndarray  # [N, 3] m
    faces: np.ndarray  # [N] rows of the mesh's faces


def sample_surface(
    mesh: trimesh.Trimesh, count: int, seed: int, views: Views | None = None
) -> SurfaceSamples:
    """Up to `count` observed points, uniform over the area; one seed always gives the same."""
    rng = np.random.default_rng(seed)
    corners = np.asarray(mesh.vertices, np.float64)[np.asarray(mesh.faces)]  # [F, 3, 3]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    cumulative = np.cumsum(np.linalg.norm(cross, axis=1))
    points, faces, found = [np.empty((0, 3))], [np.empty(0, np.int64)], 0
    for _ in range(_MOST_DRAWS if len(corners) and cumulative[-1] > 0 else 0):
        rows = np.searchsorted(cumulative, rng.random(count) * cumulative[-1], side="right")
        rows = np.minimum(rows, len(corners) - 1)
        chosen = corners[rows]
        a, b = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
        drawn = (1 - a) * chosen[:, 0] + a * (1 - b) * chosen[:, 1] + a * b * chosen[:, 2]
        seen = views.observed(drawn) if views else np.ones(count, bool)
        points.append(drawn[seen])
        faces.append(rows[seen])
        found += int(seen.sum())
        if found >= count:
            break
    return SurfaceSamples(np.concatenate(points)[:count], np.concatenate(faces)[:count])


def distances(points: ArrayLike, vertices: ArrayLike, faces: ArrayLike) -> np.ndarray:
    """Exact distance [N] m of points [N, 3] to the triangles `faces` [F, 3] between vertices [V, 3], m."""
    vertices, faces = np.asarray(vertices, np.float64), np.asarray(faces, np.int64)
    tree = igl.AABB()
    tree.init(vertices, faces)
    squared, _, _ = tree.squared_distance(vertices, faces, np.asarray(points, np.float64))
    return np.sqrt(squared)


def _observed_faces(
    samples: SurfaceSamples, mesh: trimesh.Trimesh, views: Views | None
) -> np.ndarray:
    """Faces [F, 3] with an observed sample or centroid: many small ones have no sample."""
    faces = np.asarray(mesh.faces)
    if views is None:
        return faces
    seen = views.observed(np.asarray(mesh.vertices, np.float64)[faces].mean(axis=1))
    seen[samples.faces] = True
    return faces[seen]
