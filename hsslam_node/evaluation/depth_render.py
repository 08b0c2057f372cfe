"""What a depth camera would see of a triangle mesh."""

import numba
import numpy as np

from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import inverse

_NEAR_M = 0.01


def render_depth(
    vertices: np.ndarray, faces: np.ndarray, camera: Camera, T_world_cam: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Planar depth [H, W] float32 m (0: nothing) and face number [H, W] int32 (-1: nothing).

    Faces count from both sides. A pixel shows what its centre's ray meets first. Exact at the
    image's border and for faces that reach behind the camera (homogeneous edge functions, Olano and
    Greer 1997).

    Args:
        vertices: [N, 3] m, world.
        faces: [F, 3].
        camera: pinhole, no distortion.
        T_world_cam: [4, 4].
    """
    T = inverse(T_world_cam)
    seen = np.asarray(vertices, np.float64) @ T[:3, :3].T + T[:3, 3]
    depth = np.zeros((camera.height_px, camera.width_px), np.float32)
    face = np.full(depth.shape, -1, np.int32)
    intrinsics = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    _rasterise(seen, np.ascontiguousarray(faces, np.int64), intrinsics, depth, face)
    return depth, face


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _rasterise(points, faces, intrinsics, depth, face):
    height, width = depth.shape
    fx, fy, cx, cy = intrinsics
    for f in range(len(faces)):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        az, bz, cz = points[i, 2], points[j, 2], points[k, 2]
        if az < _NEAR_M and bz < _NEAR_M and cz < _NEAR_M:
            continue
        ax, ay, bx, by = points[i, 0], points[i, 1], points[j, 0], points[j, 1]
        dx, dy = points[k, 0], points[k, 1]
        if az >= _NEAR_M and bz >= _NEAR_M and cz >= _NEAR_M:
            ua, ub, uc = ax / az, bx / bz, dx / cz
            va, vb, vc = ay / az, by / bz, dy / cz
            low_u, high_u = min(ua, ub, uc) * fx + cx, max(ua, ub, uc) * fx + cx
            low_v, high_v = min(va, vb, vc) * fy + cy, max(va, vb, vc) * fy + cy
        else:
            low_u, high_u, low_v, high_v = _clipped_box(points[i], points[j], points[k], intrinsics)
        first_u = max(np.ceil(low_u - 1e-6), 0.0)
        last_u = min(np.floor(high_u + 1e-6), width - 1.0)
        first_v = max(np.ceil(low_v - 1e-6), 0.0)
        last_v = min(np.floor(high_v + 1e-6), height - 1.0)
        if not (first_u <= last_u and first_v <= last_v):
            continue
        # cross products of the corners: their signs along a ray tell its side of the edges
        p0, p1, p2 = by * cz - bz * dy, bz * dx - bx * cz, bx * dy - by * dx
        q0, q1, q2 = dy * az - cz * ay, cz * ax - dx * az, dx * ay - dy * ax
        r0, r1, r2 = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        volume = ax * p0 + ay * p1 + az * p2
        for v in range(int(first_v), int(last_v) + 1):
            y = (v - cy) / fy
            for u in range(int(first_u), int(last_u) + 1):
                x = (u - cx) / fx
                e0 = p0 * x + p1 * y + p2
                e1 = q0 * x + q1 * y + q2
                e2 = r0 * x + r1 * y + r2
                inside = (e0 >= 0 and e1 >= 0 and e2 >= 0) or (e0 <= 0 and e1 <= 0 and e2 <= 0)
                total = e0 + e1 + e2
                if not inside or total == 0:
                    continue
                z = volume / total
                if z >= _NEAR_M and (face[v, u] < 0 or z < depth[v, u]):
                    depth[v, u] = z
                    face[v, u] = f


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _clipped_box(a, b, c, intrinsics):
    """Pixels that the part of a triangle in front of the camera can cover."""
    fx, fy, cx, cy = intrinsics
    low_u = low_v = np.inf
    high_u = high_v = -np.inf
    for k in range(3):
        p = a if k == 0 else b if k == 1 else c
        q = b if k == 0 else c if k == 1 else a
        for end in range(2):
            if end == 0:
                if p[2] < _NEAR_M:
                    continue
                x, y, z = p[0], p[1], p[2]
            else:
                if (p[2] < _NEAR_M) == (q[2] < _NEAR_M):
                    continue
                t = (_NEAR_M - p[2]) / (q[2] - p[2])
                x, y, z = p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1]), _NEAR_M
            u, v = x / z * fx + cx, y / z * fy + cy
            low_u, high_u = min(low_u, u), max(high_u, u)
            low_v, high_v = min(low_v, v), max(high_v, v)
    return low_u, high_u, low_v, high_v
