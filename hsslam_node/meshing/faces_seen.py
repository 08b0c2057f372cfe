"""Selects triangles that a camera saw and that are still there; others are guesses, or were removed."""

from collections.abc import Sequence
from concurrent.futures import Executor
from typing import NamedTuple

import numpy as np

from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import inverse
from hsslam_node.kernels.compiled import njit

_TOLERANCE_M = 0.02
# 1/m, times the squared depth, like the noise of a depth camera
_TOLERANCE_PER_M = 0.004
_LEAST_COSINE = -0.1  # between normal and ray to the camera: rims may turn a little
_STILL_THERE = 0.5  # of the tolerance: closer depth shows that the triangle is still there
_THROUGH = 3  # keyframes that have to look through a triangle that is gone
_BEHIND_M = 0.03  # plus twice the tolerance: how far behind the triangle they have to see
# on each side of the triangle they have to see as far: not only past the edge of an object
_ABOUT_M = 0.03
_RINGS = 6  # of triangles around a gone one
_NEVER = np.iinfo(np.int32).max
_FAR_M = 4.0  # from farther away a keyframe never counts as looking through
_SAMPLES = 4  # pixels along each side of a triangle's surroundings
_NEAREST_M = 0.01
_CHUNK = 256  # triangles that one test finds in or out of an image
_CHUNKS_AT_ONCE = 256


class _Looks(NamedTuple):
    """State of the triangles after some keyframes; the newest comes first."""

    centres: np.ndarray  # [F, 3] m, world
    normals: np.ndarray  # [F, 3]
    spheres: np.ndarray  # [C, 4] m: middle and radius of each chunk of centres
    order: np.ndarray  # [F] int32, triangle numbers; in each chunk the waiting ones first
    waiting: np.ndarray  # [C] int64, triangles of a chunk that older keyframes may change
    seen: np.ndarray  # [F] bool: measured, from the front
    through: np.ndarray  # [F] uint8, keyframes that looked through since it was last measured
    met_at: np.ndarray  # [F] int32, newest keyframe that measured it, from any side; -1: none
    gone_at: np.ndarray  # [F] int32, keyframe since which it is gone; -1: it is not


def faces_seen(
    vertices: np.ndarray,
    faces: np.ndarray,
    camera: Camera,
    keyframes: Sequence[tuple[np.ndarray, np.ndarray]],
    pool: Executor,
) -> np.ndarray:
    """Mask [F] of the triangles that a keyframe measured from the front and that are not gone.

    A triangle whose vertices all belong to measured ones counts as well, as keyframes miss single triangles.
    The mask leaves out false surfaces of the field, where no ray ended: along the rays between the edge of
    an object and the background, and sometimes a second skin inside objects.

    A triangle is gone if three keyframes looked through it and its surroundings and no later one measured
    it. So are the triangles around it, up to six rings, that no keyframe has measured since.

    Args:
        vertices: [V, 3] m, world.
        faces: [F, 3], counter-clockwise as seen from free space; faster if neighbours follow each other.
        camera: undistorted.
        keyframes: depth [H, W] float32 m, planar, 0 = no measurement, and T_world_cam [4, 4]; oldest first.
        pool: processes parts of the mesh in parallel and loads the next keyframe.
    """
    looks = _no_looks(np.asarray(vertices, np.float64)[faces])  # of corners [F, 3, 3]
    intrinsics = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    parts = range(0, len(looks.spheres), _CHUNKS_AT_ONCE)
    last = len(keyframes) - 1
    coming = pool.submit(keyframes.__getitem__, last) if last >= 0 else None
    for k in range(last, -1, -1):
        assert coming is not None
        depth_m, T_world_cam = coming.result()
        if k > 0:
            coming = pool.submit(keyframes.__getitem__, k - 1)
        depth_m = np.ascontiguousarray(depth_m, np.float32)
        T_cam_world, position = inverse(T_world_cam), np.asarray(T_world_cam)[:3, 3].copy()
        at_work = [
            pool.submit(_look, *looks, first, k, depth_m, T_cam_world, position, intrinsics)
            for first in parts
        ]
        for part in at_work:
            part.result()
    touched = np.zeros(len(vertices), np.bool_)
    touched[faces[looks.seen].ravel()] = True
    since = np.full(len(vertices), _NEVER, np.int32)
    _spread(looks.gone_at, looks.met_at, np.asarray(faces, np.int64), since)
    return np.asarray(touched[faces].all(axis=1)) & (looks.gone_at < 0)


def _no_looks(corners: np.ndarray) -> _Looks:
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-20
    centres = corners.mean(axis=1)
    count = len(centres)
    firsts = np.arange(0, count, _CHUNK)
    low, high = (f.reduceat(centres, firsts) for f in (np.minimum, np.maximum))
    spheres = np.column_stack([(low + high) / 2, np.linalg.norm(high - low, axis=1) / 2])
    waiting = np.diff(np.append(firsts, count))
    order = np.arange(count, dtype=np.int32)
    seen, through = np.zeros(count, np.bool_), np.zeros(count, np.uint8)
    met_at, gone_at = np.full((2, count), -1, np.int32)
    return _Looks(centres, normals, spheres, order, waiting, seen, through, met_at, gone_at)


@njit(cache=True, nogil=True, error_model="numpy")
def _spread(gone_at, met_at, faces, since):
    """Mark as gone, ring by ring, triangles around gone ones that were not measured since.

    Args:
        gone_at, met_at: as in `_Looks`; the first is written.
        faces: [F, 3].
        since: [V] int32, `_NEVER`; becomes the least `gone_at` of the triangles at each vertex.
    """
    for _ in range(_RINGS):
        for i in range(len(faces)):
            if gone_at[i] >= 0:
                for corner in range(3):
                    vertex = faces[i, corner]
                    since[vertex] = min(since[vertex], gone_at[i])
        for i in range(len(faces)):
            if gone_at[i] >= 0:
                continue
            for corner in range(3):
                at = since[faces[i, corner]]
                if at < _NEVER and at > met_at[i]:
                    gone_at[i] = max(gone_at[i], at)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _look(
    centres,
    normals,
    spheres,
    order,
    waiting,
    seen,
    through,
    met_at,
    gone_at,
    first_chunk,
    k,
    depth,
    T,
    position,
    intrinsics,
):
    """Update the triangles of some chunks from keyframe k; the first nine arguments are `_Looks`."""
    height, width = depth.shape
    fx, fy, cx, cy = intrinsics
    for chunk in range(first_chunk, min(first_chunk + _CHUNKS_AT_ONCE, len(waiting))):
        if waiting[chunk] == 0 or not _is_in_image(spheres[chunk], height, width, T, intrinsics):
            continue
        for n in range(chunk * _CHUNK + waiting[chunk] - 1, chunk * _CHUNK - 1, -1):
            i = order[n]
            x, y, z = centres[i, 0], centres[i, 1], centres[i, 2]
            ahead = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
            if ahead < _NEAREST_M:
                continue
            across = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
            down = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
            right, below = across / ahead * fx + cx + 0.5, down / ahead * fy + cy + 0.5
            if right < 0 or below < 0 or right >= width or below >= height:
                continue
            u, v = int(right), int(below)
            tolerance = _TOLERANCE_M + _TOLERANCE_PER_M * ahead * ahead
            nearest, off = _about_pixel(depth, u, v, ahead)
            if off < tolerance:
                seen[i] |= _shows_front(centres, normals, i, position)
            if off < _STILL_THERE * tolerance:
                met_at[i] = max(met_at[i], k)
            elif met_at[i] < 0 and ahead < _FAR_M:
                beyond = ahead + 2.0 * tolerance + _BEHIND_M
                reach = int(_ABOUT_M * fx / ahead + 0.5)
                if nearest > beyond and _is_far_about(depth, u, v, reach, beyond):
                    through[i] += 1
                    if through[i] == _THROUGH:
                        gone_at[i] = k
            if (seen[i] and met_at[i] >= 0) or gone_at[i] >= 0:
                waiting[chunk] -= 1
                last = chunk * _CHUNK + waiting[chunk]
                order[n], order[last] = order[last], order[n]


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _is_in_image(sphere, height, width, T, intrinsics):
    """Whether a sphere [4], m, may be in the image."""
    fx, fy, cx, cy = intrinsics
    x, y, z = (
        T[0, 0] * sphere[0] + T[0, 1] * sphere[1] + T[0, 2] * sphere[2] + T[0, 3],
        T[1, 0] * sphere[0] + T[1, 1] * sphere[1] + T[1, 2] * sphere[2] + T[1, 3],
        T[2, 0] * sphere[0] + T[2, 1] * sphere[1] + T[2, 2] * sphere[2] + T[2, 3],
    )
    left, right = cx + 1.0, width - cx  # px from the optical axis
    up, down = cy + 1.0, height - cy
    radius = sphere[3]
    return (
        z + radius > _NEAREST_M
        and fx * x + left * z > -radius * np.hypot(fx, left)
        and right * z - fx * x > -radius * np.hypot(fx, right)
        and fy * y + up * z > -radius * np.hypot(fy, up)
        and down * z - fy * y > -radius * np.hypot(fy, down)
    )


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _about_pixel(depth, u, v, ahead):
    """Compare a pixel and its neighbours with `ahead`, m: at a grazing angle depth changes by the pixel.

    Returns their least depth, m (0 if one has none), and their least difference from `ahead`, m.
    """
    height, width = depth.shape
    nearest = off = np.float32(np.inf)
    for row in range(max(v - 1, 0), min(v + 2, height)):
        for column in range(max(u - 1, 0), min(u + 2, width)):
            measured = depth[row, column]
            nearest = min(nearest, measured)
            off = min(off, abs(measured - ahead) if measured > 0 else np.float32(np.inf))
    return nearest, off


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _is_far_about(depth, u, v, reach, beyond):
    """Whether all sampled pixels up to `reach` on each side of one measured more than `beyond`."""
    height, width = depth.shape
    if u < reach or v < reach or u + reach >= width or v + reach >= height:
        return False
    for a in range(_SAMPLES):
        for b in range(_SAMPLES):
            row = v - reach + 2 * reach * a // (_SAMPLES - 1)
            column = u - reach + 2 * reach * b // (_SAMPLES - 1)
            if not depth[row, column] > beyond:
                return False
    return True


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _shows_front(centres, normals, i, position):
    to_camera = 0.0
    squared = 0.0
    for a in range(3):
        d = position[a] - centres[i, a]
        to_camera += normals[i, a] * d
        squared += d * d
    return to_camera > _LEAST_COSINE * np.sqrt(squared)
