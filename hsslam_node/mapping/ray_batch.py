"""A batch of rays drawn from keyframes, with the depth of each ray."""

from typing import NamedTuple

import numpy as np

from hsslam_node.config.mapping import MapperConfig
from hsslam_node.depth_noise import surface_limit
from hsslam_node.geometry.bound import Bound
from hsslam_node.kernels.mapping.ray_batch import gather_pixels
from hsslam_node.map.store import KeyframeStore, RetiredKeyframeError
from hsslam_node.mapping.ray_need import RayNeed
from hsslam_node.mapping.ray_views import RayViews

_REMEMBERED = 8192  # keyframes in the cache; the noise of one takes 0.3 ms
_NEAREST_M = 0.01  # reach of a ray from outside the bound


class DepthAveraging:
    """Radius of the mean depth around a pixel, and the limit of one surface in each keyframe.

    An iteration sees few rays of a far surface, each with centimetres of noise. The noise of inverse depth
    is the same near and far, and inverse depth is linear on a plane, so the mean of pixels on opposite
    sides lies on the plane (`kernels/depth_mean.py`).
    """

    def __init__(self, window_px: int) -> None:
        self.radius_px = window_px // 2
        self._same_surface: dict[int, float] = {}

    def same_surface(self, store: KeyframeStore, keyframe: int) -> float:
        """Largest difference of inverse depth, 1/m, on one surface; 0: depth is not averaged.

        Raises:
            RetiredKeyframeError: the keyframe is not kept.
        """
        if self.radius_px == 0:
            return 0.0
        if keyframe not in self._same_surface:
            if len(self._same_surface) >= _REMEMBERED:
                self._same_surface.clear()
            self._same_surface[keyframe] = surface_limit(store.frame(keyframe))
        return self._same_surface[keyframe]


class RayBatch(NamedTuple):
    """Arrays for up to R rays; `slot` numbers the keyframes of the batch."""

    direction: np.ndarray  # [R, 3] float32, camera frame, z = 1
    depth: np.ndarray  # [R] float32 m, planar; without measurement minus the reach
    color: np.ndarray  # [R, 3] float32 0..1
    slot: np.ndarray  # [R] int64

    def part(self, rows: slice) -> "RayBatch":
        """Views of the rows of these rays."""
        return RayBatch(
            self.direction[rows], self.depth[rows], self.color[rows], self.slot[rows]
        )  # fmt: skip


def ray_batch(rays: int) -> RayBatch:
    """An empty batch."""
    return RayBatch(
        np.zeros((rays, 3), np.float32),
        np.zeros(rays, np.float32),
        np.zeros((rays, 3), np.float32),
        np.zeros(rays, np.int64),
    )


class RayDraw:
    """Draws pixels of keyframes as rays and sets their depth."""

    def __init__(self, config: MapperConfig, *, blind: bool = False) -> None:
        """`blind`: pixels without depth become rays as well; `place_blind_rays` gives them their reach."""
        self._max_depth_m = config.max_depth_m
        self._blind = blind
        self._averaging = DepthAveraging(config.depth_window_px)
        self._views = RayViews(config.ray_views)

    def fill(
        self,
        batch: RayBatch,
        store: KeyframeStore,
        keyframes: np.ndarray,
        counts: np.ndarray,
        generator: np.random.Generator,
        need: RayNeed | None = None,
    ) -> int:
        """Fill the batch with random pixels, uniform or by `need`; returns the number of rays.

        Args:
            keyframes: [n] ids; the rays of keyframes[k] get slot k.
            counts: [n] wanted rays of each; a keyframe with many holes may give fewer.
        """
        camera, averaging = store.camera, self._averaging
        K = np.array([camera.fx, camera.fy, camera.cx, camera.cy], np.float32)
        candidates = 2 * np.asarray(counts, np.int64) + 16
        last = np.cumsum(candidates)
        total = int(last[-1])
        uv = np.empty((total, 2), np.int64)
        if need is None:
            uv[:, 0] = generator.integers(0, camera.width_px, total, np.int32)
            uv[:, 1] = generator.integers(0, camera.height_px, total, np.int32)
        else:
            wanted = zip(keyframes, candidates, strict=True)
            uv[:] = np.concatenate([need.pixels(int(k), int(n), generator) for k, n in wanted])
        self._views.find(store, keyframes)
        filled = 0
        for slot, (k, wanted) in enumerate(zip(keyframes, counts, strict=True)):
            try:
                color, depth_raw = store.pixels(int(k))
                same_surface = averaging.same_surface(store, int(k))
            except RetiredKeyframeError:  # by another process, meanwhile
                continue
            mine = slice(last[slot] - candidates[slot], last[slot])
            found = gather_pixels(
                color, depth_raw, 1.0 / store.depth_units_per_m, self._max_depth_m, K, uv[mine],
                averaging.radius_px, same_surface, self._blind, slot, batch, filled, int(wanted),
            )  # fmt: skip
            rays = slice(filled, filled + found)
            self._views.average(store, slot, batch.direction[rays], batch.depth[rays], same_surface)
            filled += found
        return filled


def place_blind_rays(batch: RayBatch, poses: np.ndarray, bound: Bound) -> None:
    """Set the depth of rays without measurement, from poses [slots, 4, 4], to minus the planar depth at
    which they leave the bound: their samples reach that far."""
    blind = np.flatnonzero(batch.depth <= 0)
    if len(blind) == 0:
        return
    T_world_cam = poses[batch.slot[blind]]  # [n, 4, 4]
    along = np.einsum("nij,nj->ni", T_world_cam[:, :3, :3], batch.direction[blind])
    side = np.where(along > 0, bound.high, bound.low)  # [n, 3] m, of the walls ahead
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.where(along == 0, np.inf, (side - T_world_cam[:, :3, 3]) / along).min(axis=1)
    batch.depth[blind] = -np.maximum(far, _NEAREST_M)
