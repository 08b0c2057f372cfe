"""Virtual views of what cameras saw, from other places: random by seed, from the truth alone."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import igl
import numpy as np
import trimesh

from hsslam_node.evaluation.mesh.visibility import Views
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import world_points
from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.rendering.chunked_mesh import ChunkedMesh, chunked_mesh
from hsslam_node.rendering.depth_render import render_depth

MOVED_M = 0.5
TURNED_RAD = np.deg2rad(45.0)
LEAST_OBSERVED = 0.99  # share of the pixels that must show what a given camera saw
LEAST_FILLED = 0.5  # share of the pixels that must show anything within reach
_NEAREST_M = 0.2
_STEP_PX = 4  # between the pixels that are checked
_MOST_TRIES = 30  # times the wanted number
_MOST_IN_VAIN = 300  # failed tries in a row: the cameras saw too little


def virtual_views(
    truth: trimesh.Trimesh, views: Views, camera: Camera, count: int, seed: int = 0
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Up to `count` pairs (T_world_cam [4, 4], true depth [H, W] float32 m) as `camera` sees them.

    A random given camera is moved by up to 0.5 m in any direction, and turned by up to 45 degrees
    about any axis. The view counts if no surface is between the two places, none is nearer than 20 cm,
    and 99 % of its pixels show surface that a given camera observed: it sees small gaps that objects
    hid, but no rooms that the camera did not visit. It sees no farther than the given cameras did.
    """
    rng = np.random.default_rng(seed)
    surface = chunked_mesh(truth.vertices, truth.faces)
    candidates = _candidates(surface, views.T_world_cam, rng, _MOST_TRIES * count)
    reach_m = float(views.depths_m.max(initial=0.0))
    thin = _of_every_nth_pixel(camera)  # most candidates are refused by few pixels
    found, in_vain = 0, 0
    for T in candidates:
        is_good = _shows_observed(view_of(surface, thin, T, reach_m), thin, T, views)
        if is_good and _is_far(depth := view_of(surface, camera, T, reach_m)):
            yield T, depth
            found, in_vain = found + 1, 0
        else:
            in_vain += 1
        if found == count or in_vain == _MOST_IN_VAIN:
            return


def view_of(surface: ChunkedMesh, camera: Camera, T: np.ndarray, reach_m: float) -> np.ndarray:
    """Depth [H, W] float32 m as a sensor of this reach sees a surface; 0: nothing."""
    depth, _ = render_depth(surface, camera, T)
    depth[depth > reach_m] = 0.0
    return depth


def _of_every_nth_pixel(camera: Camera) -> Camera:
    """The camera of the pixels that are checked, one of 4 x 4, which look along the same rays."""
    first, step = _STEP_PX // 2, _STEP_PX
    return replace(
        camera,
        width_px=len(range(first, camera.width_px, step)),
        height_px=len(range(first, camera.height_px, step)),
        fx=camera.fx / step,
        fy=camera.fy / step,
        cx=(camera.cx - first) / step,
        cy=(camera.cy - first) / step,
    )


def _candidates(
    surface: ChunkedMesh, poses: np.ndarray, rng: np.random.Generator, tries: int
) -> Iterator[np.ndarray]:
    walls = _Walls(surface)
    for _ in range(tries if len(poses) else 0):
        start = poses[rng.integers(len(poses))]
        T = start.copy()
        T[:3, 3] += _in_ball(rng) * MOVED_M
        turn = np.concatenate([np.zeros(3), _in_ball(rng) * TURNED_RAD])
        T[:3, :3] = start[:3, :3] @ se3_exp(turn)[:3, :3]
        if not walls.is_between(start[:3, 3], T[:3, 3]):
            yield T


def _in_ball(rng: np.random.Generator) -> np.ndarray:
    """Uniform in the unit ball, [3]."""
    direction = rng.normal(size=3)
    return direction / np.linalg.norm(direction) * np.cbrt(rng.random())


def _shows_observed(depth: np.ndarray, camera: Camera, T: np.ndarray, views: Views) -> bool:
    """Whether enough of the pixels [H, W] m show anything, and what a camera saw."""
    if (depth > 0).sum() < LEAST_FILLED * depth.size:
        return False
    return views.observed(world_points(depth, camera, T)).mean() >= LEAST_OBSERVED


def _is_far(depth: np.ndarray) -> bool:
    return depth[depth > 0].min() >= _NEAREST_M


class _Walls:
    """Finds faces of a surface between two points."""

    def __init__(self, surface: ChunkedMesh) -> None:
        self._surface = surface
        self._tree = igl.AABB()
        self._tree.init(surface.vertices, surface.faces)

    def is_between(self, start: np.ndarray, end: np.ndarray) -> bool:
        """Whether a face crosses the line between two points [3]."""
        found: Any = self._tree.intersect_ray_first(
            self._surface.vertices, self._surface.faces, start[None], (end - start)[None]
        )
        faces, at, _ = found
        return bool(faces[0] >= 0 and at[0] <= 1.0)
