"""Spreads rays evenly over the surface, so that rarely seen parts get their share."""

import numpy as np

from hsslam_node.geometry.projection import pixel_rays
from hsslam_node.geometry.se3 import transformed
from hsslam_node.map.store import KeyframeStore

_STRIDE_PX = 8
_CELL_M = 0.12
_BITS = 21  # of a cell's number along an axis


class RayNeed:
    """Draws keyframes and pixels so that rays spread over the surface, not over the images.

    Space is divided into cells of 12 cm. A pixel's weight is one over the number of pixels of all kept
    keyframes in its cell, so all cells get the same number of rays. Without weights, near surfaces in all
    keyframes would get nearly all rays, and far, grazing or rarely seen surfaces hardly any.
    """

    def __init__(self, store: KeyframeStore, max_depth_m: float) -> None:
        self.ids = store.kept()  # kept keyframes at creation, sorted [n] int64
        poses = store.poses_of(self.ids)
        cells = [
            _cells(store, int(k), T, max_depth_m) for k, T in zip(self.ids, poses, strict=True)
        ]
        _, cell, seen = np.unique(np.concatenate(cells), return_inverse=True, return_counts=True)
        weight = np.where(np.concatenate(cells) >= 0, 1.0 / seen[cell], 0.0)
        per_keyframe = weight.reshape(len(poses), -1)
        camera = store.camera
        self._columns = -(-camera.width_px // _STRIDE_PX)
        self._last_pixel = np.array([camera.width_px - 1, camera.height_px - 1])
        self._cumulative = np.cumsum(per_keyframe, axis=1)  # [n, every eighth pixel]

    def keyframes(self, size: int, generator: np.random.Generator) -> np.ndarray:
        """Draw up to `size` different keyframes by the total weight of their pixels, [n] int64."""
        total = self._cumulative[:, -1]
        size = min(size, int(np.count_nonzero(total)))
        return self.ids[generator.choice(len(total), size, replace=False, p=total / total.sum())]

    def pixels(self, keyframe: int, count: int, generator: np.random.Generator) -> np.ndarray:
        """Draw pixels (u, v) [count, 2] int64 of a keyframe; some may have no depth."""
        cumulative = self._cumulative[np.searchsorted(self.ids, keyframe)]
        place = np.searchsorted(cumulative, generator.random(count) * cumulative[-1], side="right")
        place = np.minimum(place, len(cumulative) - 1)
        corner = np.stack([place % self._columns, place // self._columns], axis=-1) * _STRIDE_PX
        around = generator.integers(-_STRIDE_PX // 2, _STRIDE_PX // 2, (count, 2))
        return np.clip(corner + around, 0, self._last_pixel)


def _cells(
    store: KeyframeStore, keyframe: int, T_world_cam: np.ndarray, max_depth_m: float
) -> np.ndarray:
    """Number of the cell of every eighth pixel, row by row [N] int64; -1 without measurement."""
    camera = store.camera
    depth = store.frame(keyframe).depth_m()[::_STRIDE_PX, ::_STRIDE_PX].astype(np.float64)
    v, u = np.mgrid[: depth.shape[0], : depth.shape[1]] * _STRIDE_PX
    points = transformed(T_world_cam, pixel_rays(u, v, camera) * depth[..., None])
    x, y, z = np.moveaxis(np.floor(points / _CELL_M).astype(np.int64) + (1 << _BITS - 1), -1, 0)
    cell = (x << 2 * _BITS) + (y << _BITS) + z
    return np.where((depth > 0) & (depth < max_depth_m), cell, -1).ravel()
