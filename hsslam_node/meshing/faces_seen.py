"""Which triangles of a mesh some camera looked at: the others are guesses of the field."""

from collections.abc import Sequence
from concurrent.futures import Executor

import numpy as np
from numba import njit

from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import inverse

_TOLERANCE_M = 0.02
_TOLERANCE_PER_M = (
    0.004  # 1/m, times the squared depth: the noise of a depth camera grows like that
)
_LEAST_COSINE = (
    -0.1
)  # between a triangle's normal and the ray to the camera: rims may turn a little


def faces_seen(
    vertices: np.ndarray,
    faces: np.ndarray,
    camera: Camera,
    keyframes: Sequence[tuple[np.ndarray, np.ndarray]],
    pool: Executor,
) -> np.ndarray:
    """Mask [F] of the triangles that a keyframe measured and that do not show it their back.

    A triangle whose three vertices belong to such ones counts as well: single ones are missed.

    Between the edge of an object and what lies behind it the field has a surface along the rays, and
    inside sometimes a second skin: no ray ever ended there.

    Args:
        vertices: [V, 3] m, world.
        faces: [F, 3], counter-clockwise as seen from free space.
        camera: undistorted.
        keyframes: depth [H, W] float32 m, planar, 0 = no measurement, and T_world_cam [4, 4].
        pool: looks through keyframes at once; all that they write is "seen".
    """
    corners = np.asarray(vertices, np.float64)[faces]  # [F, 3, 3]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-20
    seen = np.zeros(len(corners), np.bool_)
    centres = corners.mean(axis=1)
    intrinsics = np.array([camera.fx, camera.fy, camera.cx, camera.cy])

    def look(k: int) -> None:
        depth_m, T_world_cam = keyframes[k]
        depth_m = np.ascontiguousarray(depth_m, np.float32)
        T_cam_world, position = inverse(T_world_cam), np.asarray(T_world_cam)[:3, 3].copy()
        _mark_seen(centres, normals, depth_m, T_cam_world, position, intrinsics, seen)

    for _ in pool.map(look, _spread_order(len(keyframes))):
        pass
    touched = np.zeros(len(vertices), np.bool_)
    touched[faces[seen].ravel()] = True
    return np.asarray(touched[faces].all(axis=1))


def _spread_order(count: int) -> list[int]:
    """All numbers below `count`, distant ones first: then most triangles are soon settled."""
    return [k for first in range(8) for k in range(first, count, 8)]


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _mark_seen(centres, normals, depth, T, position, intrinsics, seen):
    height, width = depth.shape
    for i in range(len(centres)):
        if seen[i]:
            continue
        x, y, z = centres[i]
        ahead = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        if ahead < 0.01:
            continue
        across = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
        down = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
        u = np.floor(across / ahead * intrinsics[0] + intrinsics[2] + 0.5)
        v = np.floor(down / ahead * intrinsics[1] + intrinsics[3] + 0.5)
        if u < 0 or v < 0 or u >= width or v >= height:
            continue
        tolerance = _TOLERANCE_M + _TOLERANCE_PER_M * ahead * ahead
        if not _is_measured(depth, int(u), int(v), ahead, tolerance):
            continue
        to_camera = 0.0
        distance = 0.0
        for a in range(3):
            d = position[a] - centres[i, a]
            to_camera += normals[i, a] * d
            distance += d * d
        if to_camera > _LEAST_COSINE * np.sqrt(distance):
            seen[i] = True  # never False: another thread may have seen it meanwhile


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _is_measured(depth, u, v, ahead, tolerance):
    """Whether a pixel or a neighbour measured this depth: along a flat angle it changes by the pixel."""
    height, width = depth.shape
    for row in range(max(v - 1, 0), min(v + 2, height)):
        for column in range(max(u - 1, 0), min(u + 2, width)):
            measured = depth[row, column]
            if measured > 0 and abs(ahead - measured) < tolerance:
                return True
    return False
