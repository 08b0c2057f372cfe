"""Distances to a map's surface along rays, and depth images of the map, by marching along the rays."""

from collections.abc import Callable

import cv2
import numpy as np

from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import pixel_rays

_NEAREST_M = 0.1  # in front of the camera
_SHORTEST_STEP = 0.2  # in truncations; the longest is one
_MOST_CASTS = 8  # of a ray, each from behind a surface that does not count
_SPARSE_PX = 4  # between the rays of an image that start at the camera
_MARGIN = 2.0  # in truncations: other rays start as far in front of what these have found


class SdfRayCaster:
    """Finds the first place at which a ray enters a surface from free space.

    Args:
        query_sdf: signed distances [N], in units of the truncation, at points [N, 3] m, world.
        bound: of the map; it queries nothing outside.
        truncation_m: of the map, m.
    """

    def __init__(
        self, query_sdf: Callable[[np.ndarray], np.ndarray], bound: Bound, truncation_m: float
    ) -> None:
        self._query = query_sdf
        self._bound = bound
        self._truncation_m = truncation_m

    def depth(
        self,
        camera: Camera,
        T_world_cam: np.ndarray,
        counts: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> np.ndarray:
        """Planar depth [H, W] float32 m of the surface from T_world_cam [4, 4]; 0: none.

        Every fourth ray of every fourth row starts at the camera. The others start in front of the nearest
        surface that these found around them, if they start in free space there. `counts`: as for `distances`;
        None: all surfaces count.
        """
        shape = (camera.height_px, camera.width_px)
        v, u = np.mgrid[: shape[0], : shape[1]]
        rays = pixel_rays(u, v, camera) @ T_world_cam[:3, :3].T  # [H, W, 3], per metre of depth
        origins = np.broadcast_to(T_world_cam[:3, 3], rays.shape)
        near, far = self._bound.reach(origins, rays)  # [H, W]
        near = np.maximum(near, _NEAREST_M)
        few = np.s_[::_SPARSE_PX, ::_SPARSE_PX]
        sparse = self._march_image(origins[few], rays[few], near[few], far[few])
        before = _least_around(sparse, shape) - _MARGIN * self._truncation_m
        ahead = before > near
        ahead[ahead] = self._ask(origins[ahead], rays[ahead], before[ahead]) > 0
        start = np.where(ahead, before, near)
        if counts is None:
            return self._march_image(origins, rays, start, far).astype(np.float32)
        flat = origins.reshape(-1, 3), rays.reshape(-1, 3), start.ravel(), far.ravel()
        return self._first(*flat, counts).reshape(shape).astype(np.float32)

    def distances(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        most_m: float,
        counts: Callable[[np.ndarray], np.ndarray],
    ) -> np.ndarray:
        """Distances [R] m from origins [R, 3] m along unit directions [R, 3] to the surface; 0: none.

        `counts`: mask [N] of the places [N, 3] m at which a surface counts; a ray passes through others.
        """
        near, far = self._bound.reach(origins, directions)
        # one step more, as that may end behind a surface
        far = np.minimum(far, most_m + self._truncation_m)
        distance_m = self._first(origins, directions, np.maximum(near, 0.0), far, counts)
        return np.where(distance_m <= most_m, distance_m, 0.0)

    def _first(
        self,
        origins: np.ndarray,
        rays: np.ndarray,
        z: np.ndarray,
        far: np.ndarray,
        counts: Callable[[np.ndarray], np.ndarray],
    ) -> np.ndarray:
        """Depths [R] of the first surface that counts; 0: none."""
        depth, left = np.zeros(len(rays)), np.arange(len(rays))
        for _ in range(_MOST_CASTS):
            found = self._march(origins[left], rays[left], z, far[left])
            left, found = left[found > 0], found[found > 0]
            real = counts(origins[left] + found[:, None] * rays[left])
            depth[left[real]] = found[real]
            left, z = left[~real], found[~real] + _SHORTEST_STEP * self._truncation_m
        return depth

    def _march_image(
        self, origins: np.ndarray, rays: np.ndarray, z: np.ndarray, far: np.ndarray
    ) -> np.ndarray:
        """As `_march`, of rays [H, W, 3]."""
        flat = origins.reshape(-1, 3), rays.reshape(-1, 3), z.ravel(), far.ravel()
        return self._march(*flat).reshape(z.shape)

    def _march(
        self, origins: np.ndarray, rays: np.ndarray, z: np.ndarray, far: np.ndarray
    ) -> np.ndarray:
        """Depths [R] of the first change of sign from free space, refined once."""
        per_sdf = self._truncation_m / np.linalg.norm(rays, axis=1)  # depth per unit of distance
        found = np.zeros(len(rays))
        # -1: a ray that starts inside a surface first looks for free space
        last_z, last_sdf = z.copy(), np.full(len(rays), -1.0)
        active = np.flatnonzero(z < far)
        while len(active):
            sdf = self._ask(origins[active], rays[active], z[active])
            hit = (sdf <= 0) & (last_sdf[active] > 0)
            at, before, now = active[hit], last_sdf[active[hit]], sdf[hit]
            found[at] = last_z[at] + (z[at] - last_z[at]) * before / (before - now)
            last_z[active], last_sdf[active] = z[active], sdf
            z[active] += np.clip(np.abs(sdf), _SHORTEST_STEP, 1.0) * per_sdf[active]
            active = active[~hit & (z[active] < far[active])]
        at = np.flatnonzero(found)
        if len(at):
            correction = self._ask(origins[at], rays[at], found[at])
            found[at] += np.clip(correction, -_SHORTEST_STEP, _SHORTEST_STEP) * per_sdf[at]
        return found

    def _ask(self, origins: np.ndarray, rays: np.ndarray, z: np.ndarray) -> np.ndarray:
        return self._query((origins + rays * z[:, None]).astype(np.float32)).astype(np.float64)


def _least_around(sparse_m: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """For each pixel the least of the sparse depths [h, w] m around it, 0 if one of them has no surface."""
    least_m = cv2.erode(sparse_m, np.ones((3, 3)))  # beyond the border: no limit
    return least_m.repeat(_SPARSE_PX, axis=0).repeat(_SPARSE_PX, axis=1)[: shape[0], : shape[1]]
