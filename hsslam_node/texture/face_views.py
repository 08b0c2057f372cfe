"""The triangles of a mesh that one keyframe shows: their size, colour and detail in its image."""

from typing import NamedTuple

import cv2
import numpy as np

from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import inverse
from hsslam_node.kernels.compiled import njit
from hsslam_node.rendering.chunked_mesh import ChunkedMesh
from hsslam_node.rendering.depth_render import render_depth

_BORDER_PX = 3.0  # of the image, which a triangle may not touch
_LEAST_COSINE = 0.1  # between a triangle's normal and the ray to the camera
_TOLERANCE_M, _TOLERANCE_PER_M = 0.02, 0.006  # 1/m, times the squared depth: a Kinect's noise
# around a triangle: a nearer surface may bleed over it, as depth and pose are not exact
_EDGE_PX = 4
_EDGE_M = 0.05
_NEAR_M = 0.05


class FaceViews(NamedTuple):
    """The triangles that one keyframe sees whole, unoccluded and from the front."""

    faces: np.ndarray  # [n] int32
    area_px: np.ndarray  # [n] float32: of the pixels that each covers
    is_doubtful: np.ndarray  # [n] bool: a nearer surface is next to it, or depth is missing
    color: np.ndarray  # [n, 3] float32: mean red, green and blue, 0 to 255
    detail: np.ndarray  # [n] float32: mean slope of the brightness, 1/px


def views_of_faces(
    mesh: ChunkedMesh,
    camera: Camera,
    color: np.ndarray,
    depth_m: np.ndarray,
    T_world_cam: np.ndarray,
    hidden: np.ndarray,
) -> FaceViews:
    """The triangles of a mesh that a keyframe with `color` [H, W, 3] uint8 RGB at T_world_cam [4, 4] shows.

    A triangle is unoccluded if no other one is in front of it, and if the measured depth [H, W] m is missing
    or agrees with it. So objects that have moved give no colour. A mask may be why depth is missing, so
    another keyframe is better. The pixels `hidden` [H, W] bool show no triangle.
    """
    drawn_m, _ = render_depth(mesh, camera, T_world_cam)
    drawn_m[hidden] = 0.0
    grey = color.mean(axis=2, dtype=np.float32)
    slope = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1)) / 8
    nearest_m = cv2.erode(
        np.where(depth_m > 0, depth_m, np.float32(np.inf)), np.ones((2 * _EDGE_PX + 1,) * 2)
    )
    T = np.ascontiguousarray(inverse(T_world_cam), np.float64)
    intrinsics = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    depth_m, color = np.ascontiguousarray(depth_m, np.float32), np.ascontiguousarray(color)
    return FaceViews(
        *_look(mesh.vertices, mesh.faces, T, intrinsics, drawn_m, depth_m, nearest_m, color, slope)
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _look(vertices, faces, T, intrinsics, drawn, measured, nearest, image, slope):
    found = np.empty(len(faces), np.int32)
    area = np.empty(len(faces), np.float32)
    is_doubtful = np.empty(len(faces), np.bool_)
    color = np.empty((len(faces), 3), np.float32)
    detail = np.empty(len(faces), np.float32)
    seen = _in_camera(vertices, T, intrinsics)  # u, v, z of each vertex
    height, width = drawn.shape
    n = 0
    for f in range(len(faces)):
        a, b, c = seen[faces[f, 0]], seen[faces[f, 1]], seen[faces[f, 2]]
        if min(a[2], b[2], c[2]) < _NEAR_M:
            continue
        if min(a[0], b[0], c[0]) < _BORDER_PX or max(a[0], b[0], c[0]) > width - 1 - _BORDER_PX:
            continue
        if min(a[1], b[1], c[1]) < _BORDER_PX or max(a[1], b[1], c[1]) > height - 1 - _BORDER_PX:
            continue
        if _cosine(a, b, c, intrinsics) < _LEAST_COSINE:
            continue
        change, is_seen, doubt = 0.0, True, False
        color[n] = 0
        for sample in range(4):  # the middle, and a place towards each corner
            to_a = 0.6 if sample == 1 else 0.2 if sample else 1 / 3
            to_b = 0.6 if sample == 2 else 0.2 if sample else 1 / 3
            to_c = 1.0 - to_a - to_b
            z = 1.0 / (to_a / a[2] + to_b / b[2] + to_c / c[2])
            column = int(to_a * a[0] + to_b * b[0] + to_c * c[0] + 0.5)
            row = int(to_a * a[1] + to_b * b[1] + to_c * c[1] + 0.5)
            near = _TOLERANCE_M + _TOLERANCE_PER_M * z * z
            is_seen = _is_front(drawn, row, column, z, near) and (
                _is_front(measured, row, column, z, near) or _is_missing(measured, row, column)
            )
            if not is_seen:
                break
            doubt |= measured[row, column] == 0 or nearest[row, column] < z - _EDGE_M - near
            for channel in range(3):
                color[n, channel] += image[row, column, channel] / 4
            change += slope[row, column] / 4
        if not is_seen:
            continue
        found[n] = f
        area[n] = abs((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2
        is_doubtful[n], detail[n] = doubt, change
        n += 1
    return found[:n], area[:n], is_doubtful[:n], color[:n], detail[:n]


@njit(cache=True, nogil=True, error_model="numpy")
def _in_camera(vertices, T, intrinsics):
    seen = np.empty((len(vertices), 3))
    for k in range(len(vertices)):
        x, y, z = vertices[k]
        ahead = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        across = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
        down = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
        divisor = max(ahead, 1e-3)
        seen[k, 0] = across / divisor * intrinsics[0] + intrinsics[2]
        seen[k, 1] = down / divisor * intrinsics[1] + intrinsics[3]
        seen[k, 2] = ahead
    return seen


@njit(cache=True, nogil=True, error_model="numpy")
def _cosine(a, b, c, intrinsics):
    """Cosine between the normal of a triangle, given by pixels and depths, and the ray to the camera."""
    corners = np.empty((3, 3))
    for k in range(3):
        p = a if k == 0 else b if k == 1 else c
        corners[k, 0] = (p[0] - intrinsics[2]) / intrinsics[0] * p[2]
        corners[k, 1] = (p[1] - intrinsics[3]) / intrinsics[1] * p[2]
        corners[k, 2] = p[2]
    d, e = corners[1] - corners[0], corners[2] - corners[0]
    normal = np.array(
        (d[1] * e[2] - d[2] * e[1], d[2] * e[0] - d[0] * e[2], d[0] * e[1] - d[1] * e[0])
    )
    middle = (corners[0] + corners[1] + corners[2]) / 3
    lengths = np.sqrt((normal * normal).sum() * (middle * middle).sum())
    return -(normal * middle).sum() / (lengths + 1e-20)


@njit(cache=True, nogil=True, error_model="numpy")
def _is_front(depth, row, column, z, tolerance):
    """Whether a pixel or a neighbour has this depth."""
    for v in range(row - 1, row + 2):
        for u in range(column - 1, column + 2):
            if depth[v, u] > 0 and abs(depth[v, u] - z) < tolerance:
                return True
    return False


@njit(cache=True, nogil=True, error_model="numpy")
def _is_missing(depth, row, column):
    """Whether a pixel and its neighbours have no depth."""
    for v in range(row - 1, row + 2):
        for u in range(column - 1, column + 2):
            if depth[v, u] > 0:
                return False
    return True
