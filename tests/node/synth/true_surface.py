"""How far what a camera saw lies from the true mesh."""

import numpy as np
import trimesh
from scipy.spatial import KDTree

from hsslam_node.evaluation.mesh.mesh_metrics import distances
from hsslam_node.frame import Frame
from tests.node.synth.back_projection import back_projected

_NEAR_M = 0.3  # of the points: triangles farther away need no tree


def depth_errors_m(frame: Frame, T_world_cam: np.ndarray, mesh: trimesh.Trimesh) -> np.ndarray:
    """Distance from the mesh [N], m, of the points of every 23rd pixel, if it has depth; beyond `_NEAR_M` it
    may be too large."""
    points = back_projected(frame)[::23]
    points = points[points[:, 2] > 0] @ T_world_cam[:3, :3].T + T_world_cam[:3, 3]
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    low, high = points.min(0) - _NEAR_M, points.max(0) + _NEAR_M
    is_near = ((vertices > low) & (vertices < high)).all(1)
    return distances(points, vertices, faces[is_near[faces].any(1)])


def clearance_m(positions: np.ndarray, mesh: trimesh.Trimesh) -> np.ndarray:
    """Distance of camera positions [N, 3] from the nearest vertex, m; faces are 5 cm grids."""
    vertices = np.asarray(mesh.vertices)
    level = np.abs(vertices[:, 2] - positions[:, 2].mean()) < 0.6
    offsets, _ = KDTree(vertices[level]).query(positions)
    return offsets
