"""Views from places where no camera was, of what cameras saw: seeded, drawn from the truth alone."""

import itertools
from collections.abc import Iterator

import numba
import numpy as np
import trimesh

from hsslam_node.evaluation.depth_render import render_depth
from hsslam_node.evaluation.visibility import Views
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import se3_exp

MOVED_M = 0.5
TURNED_RAD = np.deg2rad(45.0)
LEAST_OBSERVED = 0.95  # share of the pixels that must show what a given camera saw
_NEAREST_M = 0.2
_STEP_PX = 4  # of the pixels that are asked whether they were observed
_MOST_TRIES = 50  # times the wanted number


def virtual_views(
    truth: trimesh.Trimesh, views: Views, camera: Camera, count: int, seed: int = 0
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Up to `count` pairs (T_world_cam [4, 4], true depth [H, W] float32 m) as `camera` sees them.

    A given camera is drawn, moved by up to 0.5 m in any direction, and turned by up to 45 degrees
    about any axis. The view counts if nothing stands between the two places, nothing is nearer than
    20 cm, and 95 % of its pixels show surface that a given camera observed: it fills the small
    gaps that objects hide, and does not ask for rooms that nobody has been to.
    """
    rng = np.random.default_rng(seed)
    vertices = np.asarray(truth.vertices, np.float64)
    faces = np.ascontiguousarray(truth.faces, np.int64)
    candidates = _candidates(vertices, faces, views.T_world_cam, rng, _MOST_TRIES * count)
    good = (
        (T, depth)
        for T in candidates
        if _is_good(depth := render_depth(vertices, faces, camera, T)[0], camera, T, views)
    )
    yield from itertools.islice(good, count)


def back_project(depth_m: np.ndarray, camera: Camera, T_world_cam: np.ndarray) -> np.ndarray:
    """World points [N, 3] m of the pixels with depth, row by row."""
    v, u = np.nonzero(depth_m > 0)
    z = depth_m[v, u].astype(np.float64)
    points = np.stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z], axis=1)
    return points @ T_world_cam[:3, :3].T + T_world_cam[:3, 3]


def _candidates(
    vertices: np.ndarray, faces: np.ndarray, poses: np.ndarray, rng: np.random.Generator, tries: int
) -> Iterator[np.ndarray]:
    for _ in range(tries if len(poses) else 0):
        start = poses[rng.integers(len(poses))]
        T = start.copy()
        T[:3, 3] += _in_ball(rng) * MOVED_M
        turn = np.concatenate([np.zeros(3), _in_ball(rng) * TURNED_RAD])
        T[:3, :3] = start[:3, :3] @ se3_exp(turn)[:3, :3]
        if not _is_blocked(vertices, faces, start[:3, 3], T[:3, 3]):
            yield T


def _in_ball(rng: np.random.Generator) -> np.ndarray:
    """Uniform in the unit ball, [3]."""
    direction = rng.normal(size=3)
    return direction / np.linalg.norm(direction) * np.cbrt(rng.random())


def _is_good(depth: np.ndarray, camera: Camera, T: np.ndarray, views: Views) -> bool:
    thin = np.zeros_like(depth)
    rows = slice(_STEP_PX // 2, None, _STEP_PX)
    thin[rows, rows] = depth[rows, rows]
    seen = thin > 0
    if not seen.any() or depth[depth > 0].min() < _NEAREST_M:
        return False
    observed = views.observed(back_project(thin, camera, T))
    return observed.sum() >= LEAST_OBSERVED * thin[rows, rows].size


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _is_blocked(vertices, faces, start, end):
    """Whether a face crosses the straight way between two points (Moeller and Trumbore 1997)."""
    d = end - start
    for f in range(len(faces)):
        a = vertices[faces[f, 0]]
        e1, e2 = vertices[faces[f, 1]] - a, vertices[faces[f, 2]] - a
        px = d[1] * e2[2] - d[2] * e2[1]
        py = d[2] * e2[0] - d[0] * e2[2]
        pz = d[0] * e2[1] - d[1] * e2[0]
        det = e1[0] * px + e1[1] * py + e1[2] * pz
        if det == 0:
            continue
        s = start - a
        u = (s[0] * px + s[1] * py + s[2] * pz) / det
        if u < 0 or u > 1:
            continue
        qx = s[1] * e1[2] - s[2] * e1[1]
        qy = s[2] * e1[0] - s[0] * e1[2]
        qz = s[0] * e1[1] - s[1] * e1[0]
        v = (d[0] * qx + d[1] * qy + d[2] * qz) / det
        if v < 0 or u + v > 1:
            continue
        t = (e2[0] * qx + e2[1] * qy + e2[2] * qz) / det
        if 0 <= t <= 1:
            return True
    return False
