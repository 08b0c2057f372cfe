"""Depth of rays, averaged over the kept keyframes near theirs that see the same surface."""

import numpy as np

from hsslam_node.config.mapping import MOST_RAY_VIEWS
from hsslam_node.geometry.se3_batch import inverse_batch
from hsslam_node.kernels.view_mean import average_depth
from hsslam_node.map.store import KeyframeStore, RetiredKeyframeError

_GATE = 2.0  # times the limit of one surface
_OWN_PIXELS = 9.0  # weight of a ray's own depth: the 25 pixels of its mean are not independent
_BEFORE_AND_AFTER = np.array([side * n for n in range(1, MOST_RAY_VIEWS + 1) for side in (-1, 1)])


class RayViews:
    """The keyframes near each keyframe of an iteration, at their present poses.

    They are the kept ones that come next before and after it, at most `most`, none from beyond a motion that
    was not tracked.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._gaps = np.zeros(0, np.int64)  # before each keyframe and the earlier ones
        self._views: list[list[int]] = []  # by slot
        self._T_view_key = np.zeros((0, most, 4, 4))  # by slot

    def find(self, store: KeyframeStore, keyframes: np.ndarray) -> None:
        """Look up the keyframes near those of an iteration, [slots] ids."""
        if self._most == 0:
            return
        kept = store.kept()
        gaps = self._gaps_until(store, store.count)
        at = (
            np.searchsorted(kept, keyframes)[:, None] + _BEFORE_AND_AFTER
        )  # [slots, 2 MOST_RAY_VIEWS]
        is_view = (at >= 0) & (at < len(kept))
        ids = kept[np.clip(at, 0, len(kept) - 1)]
        is_view &= (gaps[ids] == gaps[keyframes][:, None]) & (ids != keyframes[:, None])
        nearest = np.argsort(~is_view, axis=1, kind="stable")[:, : self._most]
        ids = np.take_along_axis(ids, nearest, axis=1)  # [slots, most]
        counts = np.minimum(is_view.sum(axis=1), self._most)
        self._views = [row[:n].tolist() for row, n in zip(ids, counts, strict=True)]
        poses = store.poses_of(np.concatenate([keyframes, ids.ravel()]))
        T_view_world = inverse_batch(poses[len(keyframes) :]).reshape(*ids.shape, 4, 4)
        self._T_view_key = T_view_world @ poses[: len(keyframes), None]

    def average(
        self,
        store: KeyframeStore,
        slot: int,
        direction: np.ndarray,
        depth: np.ndarray,
        same_surface: float,
    ) -> None:
        """Replace the depth [n] m of the rays of a slot, directions [n, 3], by the mean over its views.

        same_surface: largest difference of inverse depth, 1/m, on one surface; 0: depth is exact and stays.
        """
        if self._most == 0 or same_surface == 0.0 or not self._views[slot]:
            return
        try:
            images = [store.pixels(k)[1] for k in self._views[slot]]
        except RetiredKeyframeError:  # by another process, meanwhile
            return
        camera, padding = store.camera, [images[0]] * (MOST_RAY_VIEWS - len(images))
        K = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        average_depth(
            direction, depth, _OWN_PIXELS, self._T_view_key[slot], (*images, *padding), len(images),
            1.0 / store.depth_units_per_m, K, _GATE * same_surface,
        )  # fmt: skip

    def _gaps_until(self, store: KeyframeStore, count: int) -> np.ndarray:
        """Number of motions that were not tracked up to each of the first `count` keyframes, [count]."""
        known = len(self._gaps)
        if known < count:
            new = [store.gap_covariance(k).any() for k in range(known, count)]
            before = int(self._gaps[-1]) if known else 0
            self._gaps = np.append(self._gaps, before + np.cumsum(new, dtype=np.int64))
        return self._gaps
