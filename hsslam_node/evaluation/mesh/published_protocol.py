"""The mesh scores of the literature: culls each mesh by views of itself; samples to samples.

Source: Co-SLAM (Wang et al., CVPR 2023), supplement and `neural_slam_eval`; HS-SLAM's tables follow it.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
from scipy.spatial import KDTree

from hsslam_node.evaluation.mesh.mesh_metrics import SAMPLES, MeshMetrics, sample_surface
from hsslam_node.evaluation.mesh.virtual_views import view_of
from hsslam_node.evaluation.mesh.visibility import Views
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import transformed
from hsslam_node.rendering.chunked_mesh import chunked_mesh

TOLERANCE_M = 0.03
FAR_M = 10.0
ICP_WITHIN_M = 0.10
_ICP_POINTS = 20_000
_ICP_ITERATIONS = 30
_ICP_ENOUGH = 1e-6  # relative change of inliers and of their error: those of Open3D


@dataclass(frozen=True)
class CullingCameras:
    """Cameras that cull a mesh: a point counts if one of them sees it in its own image of that mesh."""

    camera: Camera  # pinhole, no distortion
    given: np.ndarray  # [V, 4, 4] T_world_cam of the sequence
    virtual: np.ndarray  # [W, 4, 4] T_world_cam where no camera was
    reach_m: float = FAR_M  # of all of them


class OwnDepth:
    """Points of a mesh count that are in a given camera's frustum and in any camera's image of the mesh."""

    def __init__(self, mesh: trimesh.Trimesh, cameras: CullingCameras) -> None:
        surface = chunked_mesh(mesh.vertices, mesh.faces)
        poses = np.concatenate([cameras.given, cameras.virtual])
        shape = (len(poses), cameras.camera.height_px, cameras.camera.width_px)
        depths_m = np.empty(shape, np.float32)
        for depth_m, T in zip(depths_m, poses, strict=True):
            depth_m[:] = view_of(surface, cameras.camera, T, cameras.reach_m)
        count = len(cameras.given)
        self._all = Views(cameras.camera, poses, depths_m, TOLERANCE_M)
        self._given = Views(cameras.camera, cameras.given, depths_m[:count], TOLERANCE_M)

    def observed(self, points: np.ndarray) -> np.ndarray:
        """Mask [N] of the points [N, 3] (m, world) that count."""
        return self._given.in_frustum(points) & self._all.observed(points)


def compare_as_published(
    reconstruction: trimesh.Trimesh,
    truth: trimesh.Trimesh,
    cameras: CullingCameras,
    samples: int = SAMPLES,
    seed: int = 0,
) -> MeshMetrics:
    """Distances of `samples` area-uniform points on each mesh to the nearest point on the other, m.

    A mesh hides only its own points, so points behind the true surface count if a view of the mesh shows
    them. As in the original, ICP (point to point) first moves the reconstruction onto the truth. Samples
    have gaps between them: two draws of the truth score 0.5 to 2 cm, not 0.
    """
    ours = sample_surface(reconstruction, samples, seed, OwnDepth(reconstruction, cameras)).points
    theirs = sample_surface(truth, samples, seed + 1, OwnDepth(truth, cameras)).points
    if len(ours) == 0 or len(theirs) == 0:
        return MeshMetrics.of(np.empty(0), np.empty(0))
    true = _tree(theirs)
    ours = _moved_by_icp(ours, true)
    return MeshMetrics.of(_to_nearest(ours, true), _to_nearest(theirs, _tree(ours)))


def _tree(points: np.ndarray) -> KDTree:
    """Points [N, 3] to be found; other nodes take up to 60 times as long far from a small mesh."""
    return KDTree(points, leafsize=32, compact_nodes=False, balanced_tree=False)


def _to_nearest(points: np.ndarray, target: KDTree) -> np.ndarray:
    """Distance [N] m of points [N, 3] to the nearest of others."""
    found: Any = target.query(points)
    return found[0]


def _moved_by_icp(points: np.ndarray, target: KDTree) -> np.ndarray:
    """Points [N, 3] brought rigidly onto others, by pairs within 10 cm."""
    T = np.eye(4)
    chosen = points[:: max(len(points) // _ICP_POINTS, 1)]
    before = (0.0, 0.0)
    for _ in range(_ICP_ITERATIONS):
        moved = transformed(T, chosen)
        pairs: Any = target.query(moved, distance_upper_bound=ICP_WITHIN_M)
        distance, row = pairs
        near = np.isfinite(distance)
        if near.sum() < 3:
            break
        now = (float(near.mean()), float(np.sqrt((distance[near] ** 2).mean())))
        if np.allclose(now, before, rtol=_ICP_ENOUGH, atol=0.0):
            break
        before = now
        step: Any = trimesh.registration.procrustes(
            chosen[near], target.data[row[near]], reflection=False, scale=False
        )
        T = step[0]
    return transformed(T, points)
