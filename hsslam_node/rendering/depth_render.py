"""Renders depth images of triangle meshes."""

import numpy as np

from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import inverse
from hsslam_node.kernels.compiled import njit
from hsslam_node.rendering.chunked_mesh import CHUNK, ChunkedMesh

_NEAR_M = 0.01


def render_depth(
    mesh: ChunkedMesh, camera: Camera, T_world_cam: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Planar depth [H, W] float32 m (0: nothing) and face number [H, W] int32 (-1: nothing).

    Faces show from both sides. A pixel shows the first face on the ray through its centre. Exact at the
    image's border and for faces that reach behind the camera (homogeneous edge functions, Olano and
    Greer 1997).

    Args:
        mesh: in the world.
        camera: pinhole, no distortion.
        T_world_cam: [4, 4].
    """
    depth = np.zeros((camera.height_px, camera.width_px), np.float32)
    face = np.full(depth.shape, -1, np.int32)
    intrinsics = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    T_cam_world = np.ascontiguousarray(inverse(T_world_cam), np.float64)
    _rasterise(mesh, T_cam_world, intrinsics, depth, face)
    return depth, face


@njit(cache=True, nogil=True, error_model="numpy")
def _rasterise(mesh, T, intrinsics, depth, face):
    height, width = depth.shape
    fx, fy, cx, cy = intrinsics
    ray_x, ray_y = (np.arange(width) - cx) / fx, (np.arange(height) - cy) / fy
    corners = np.empty((3, 3))
    for f in _faces_that_may_be_seen(mesh, T, intrinsics, depth.shape):
        for corner in range(3):
            k = mesh.faces[f, corner]
            x, y, z = mesh.vertices[k, 0], mesh.vertices[k, 1], mesh.vertices[k, 2]
            for a in range(3):
                corners[corner, a] = T[a, 0] * x + T[a, 1] * y + T[a, 2] * z + T[a, 3]
        ax, ay, az = corners[0, 0], corners[0, 1], corners[0, 2]
        bx, by, bz = corners[1, 0], corners[1, 1], corners[1, 2]
        dx, dy, cz = corners[2, 0], corners[2, 1], corners[2, 2]
        if az < _NEAR_M and bz < _NEAR_M and cz < _NEAR_M:
            continue
        if az >= _NEAR_M and bz >= _NEAR_M and cz >= _NEAR_M:
            ua, ub, uc = ax / az, bx / bz, dx / cz
            va, vb, vc = ay / az, by / bz, dy / cz
            low_u, high_u = min(ua, ub, uc) * fx + cx, max(ua, ub, uc) * fx + cx
            low_v, high_v = min(va, vb, vc) * fy + cy, max(va, vb, vc) * fy + cy
        else:
            low_u, high_u, low_v, high_v = _clipped_box(
                corners[0], corners[1], corners[2], intrinsics
            )
        first_u = max(np.ceil(low_u - 1e-6), 0.0)
        last_u = min(np.floor(high_u + 1e-6), width - 1.0)
        first_v = max(np.ceil(low_v - 1e-6), 0.0)
        last_v = min(np.floor(high_v + 1e-6), height - 1.0)
        if not (first_u <= last_u and first_v <= last_v):
            continue
        # cross products of the corners: their signs along a ray give its side of the edges
        p0, p1, p2 = by * cz - bz * dy, bz * dx - bx * cz, bx * dy - by * dx
        q0, q1, q2 = dy * az - cz * ay, cz * ax - dx * az, dx * ay - dy * ax
        r0, r1, r2 = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        volume = ax * p0 + ay * p1 + az * p2
        for v in range(int(first_v), int(last_v) + 1):
            y = ray_y[v]
            for u in range(int(first_u), int(last_u) + 1):
                x = ray_x[u]
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


@njit(cache=True, nogil=True, error_model="numpy")
def _faces_that_may_be_seen(mesh, T, intrinsics, size):
    """Numbers of the faces of all chunks that are not wholly out of sight, ascending."""
    found, count = np.empty(len(mesh.faces), np.int64), 0
    for chunk in range(len(mesh.boxes)):
        if _may_be_seen(mesh.boxes[chunk], T, intrinsics, size):
            for f in range(CHUNK * chunk, min(CHUNK * (chunk + 1), len(mesh.faces))):
                found[count] = f
                count += 1
    return found[:count]


@njit(cache=True, nogil=True, error_model="numpy")
def _may_be_seen(box, T, intrinsics, size):
    """False if all corners of a box are behind the camera or beyond the same border of the image."""
    fx, fy, cx, cy = intrinsics
    height, width = size
    behind = left = right = above = below = 0
    for corner in range(8):
        x, y, z = box[corner & 1, 0], box[corner >> 1 & 1, 1], box[corner >> 2, 2]
        along = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        u = (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) * fx + cx * along  # times depth
        v = (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) * fy + cy * along
        behind += along < 0
        left += u < -along
        right += u > width * along
        above += v < -along
        below += v > height * along
    return max(behind, left, right, above, below) < 8


@njit(cache=True, nogil=True, error_model="numpy")
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
