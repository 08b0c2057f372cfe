"""True surface points of a view, their normals, and the number of keyframes that saw them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hsslam_bench.field_error.true_frames import TrueFrame
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import project
from hsslam_node.geometry.se3 import inverse
from hsslam_node.kernels.tracking.depth_points import sample_points, surface_of_depth

_COLUMNS, _ROWS = 32, 24
_BORDER_PX = 8
_MARGIN_M, _MARGIN_SLOPE = 0.02, 0.01  # between two depths of one surface; m, and m/m of depth


@dataclass(frozen=True)
class SurfacePoints:
    """Points of the true surface in one view, none on an edge of the depth."""

    world: np.ndarray  # [N, 3] float32 m
    depth_m: np.ndarray  # [N] planar
    cosine: np.ndarray  # [N] of the angle between normal and ray; 1: seen from the front
    normal: np.ndarray  # [N, 3] world, away from the camera
    pixel: np.ndarray  # [N, 2] int64 (u, v)


def surface_points(view: TrueFrame, generator: np.random.Generator) -> SurfacePoints:
    """Points of exact depth at one random pixel of each cell of a grid, as the tracker samples them."""
    camera = view.frame.camera
    K = np.array([camera.fx, camera.fy, camera.cx, camera.cy], np.float32)
    depth = view.depth_m
    points = np.empty((_ROWS * _COLUMNS, 3), np.float32)
    jitter = generator.random((_ROWS * _COLUMNS, 2))
    far_m = np.float32(20.0)
    n = sample_points(depth, K, jitter, _COLUMNS, _ROWS, _BORDER_PX, far_m, 0, 0.0, points)
    points = points[:n]
    u = np.round(points[:, 0] / points[:, 2] * K[0] + K[2]).astype(np.int64)
    v = np.round(points[:, 1] / points[:, 2] * K[1] + K[3]).astype(np.int64)
    surface, normals = (
        np.empty((*depth.shape, 3), np.float32),
        np.empty((*depth.shape, 3), np.float32),
    )
    surface_of_depth(depth, K.astype(np.float64), surface, normals)
    normal = normals[v, u]
    ray = points / np.linalg.norm(points, axis=1, keepdims=True)
    cosine = np.einsum("ni,ni->n", normal, ray)
    normal = normal * np.where(cosine < 0, -1, 1)[:, None]
    R = view.T_world_cam[:3, :3]
    return SurfacePoints(
        (points @ R.T + view.T_world_cam[:3, 3]).astype(np.float32),
        points[:, 2],
        np.abs(cosine),
        normal @ R.T,
        np.stack([u, v], axis=-1),
    )


def times_seen(
    points: np.ndarray,
    keyframes: Sequence[tuple[np.ndarray, np.ndarray]],
    camera: Camera,
    far_m: float,
) -> np.ndarray:
    """Number [N] int64 of keyframes (pose [4, 4], true depth [H, W] m) that saw each of the points [N, 3]."""
    seen = np.zeros(len(points), np.int64)
    for T_world_key, depth in keyframes:
        u, v, z = project(points, camera, inverse(T_world_key))
        u, v = np.round(u).astype(int), np.round(v).astype(int)
        inside = (z > 0.1) & (z < far_m) & (u >= 0) & (v >= 0)
        inside &= (u < camera.width_px) & (v < camera.height_px)
        gap = np.abs(depth[v[inside], u[inside]] - z[inside])
        seen[inside] += gap < _MARGIN_M + _MARGIN_SLOPE * z[inside]
    return seen
