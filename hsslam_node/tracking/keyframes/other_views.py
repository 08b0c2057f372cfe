"""Depth of a keyframe, averaged over the keyframes near it that see the same surface."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.config import TrackerConfig
from hsslam_node.depth_noise import averaging_limit
from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse
from hsslam_node.kernels.view_mean import add_view
from hsslam_node.map.store import KeyframeStore, RetiredKeyframeError

_GATE = 2.0  # times the usual difference between pixels of one surface
_MOST_PIXELS = 8 * 640 * 480  # of all views


@dataclass(frozen=True)
class OtherViews:
    """Depth images of other keyframes of the same camera."""

    T_view_key: tuple[np.ndarray, ...]  # n times [4, 4]
    depth_raw: tuple[np.ndarray, ...]  # n times [H, W] uint16
    K: np.ndarray  # [4] float64
    metres_per_unit: float
    averaging_limit: float  # 1/m, of the keyframe

    def averaged(self, rays: np.ndarray, depth_m: np.ndarray, pixels: float) -> np.ndarray:
        """Depth [N] m along rays [N, 2] (x, y at z = 1, camera of the keyframe), averaged over all views.
        depth_m: [N] of the keyframe, each the mean of `pixels` pixels, 0 = unknown."""
        count = np.where(depth_m > 0, pixels, 0.0)
        total = np.divide(count, depth_m, out=np.zeros_like(count), where=depth_m > 0)
        gate = _GATE * self.averaging_limit
        for T, raw in zip(self.T_view_key, self.depth_raw, strict=True):
            add_view(rays, T, raw, self.metres_per_unit, self.K, gate, total, count)
        return np.divide(count, total, out=np.zeros_like(count), where=total > 0)


def views_near(
    store: KeyframeStore, k: int, frame: Frame, config: TrackerConfig
) -> OtherViews | None:
    """Views of up to `config.reference_views` keyframes next to keyframe k, which is `frame`, at their
    current poses; fewer of large images. None if depth is not averaged over pixels, see `averaging_limit`."""
    c = frame.camera
    most = min(config.reference_views, _MOST_PIXELS // (c.width_px * c.height_px))
    limit = averaging_limit(frame, config.depth_window_px) if most else 0.0
    if not limit:
        return None
    near = [j for j in _next_to(store, k, most) if store.is_kept(j)][:most]
    poses = store.poses_of(np.array([k, *near], np.int64))
    T_view_key, depth = [], []
    for j, T_world_view in zip(near, poses[1:], strict=True):
        try:
            raw = store.pixels(j)[1].copy()
        except RetiredKeyframeError:
            continue
        if store.is_kept(j):  # else its slot may have been reused meanwhile
            T_view_key.append(inverse(T_world_view) @ poses[0])
            depth.append(raw)
    K = np.array([c.fx, c.fy, c.cx, c.cy])
    return OtherViews(tuple(T_view_key), tuple(depth), K, 1.0 / frame.depth_units_per_m, limit)


def _next_to(store: KeyframeStore, k: int, most: int) -> list[int]:
    """Ids at most `most` from k, the nearest first; none from beyond a motion that was not tracked."""
    near = []
    for j in range(k - 1, max(k - most, 0) - 1, -1):
        if store.gap_covariance(j + 1).any():
            break
        near.append(j)
    for j in range(k + 1, min(k + most + 1, store.count)):
        if store.gap_covariance(j).any():
            break
        near.append(j)
    return sorted(near, key=lambda j: (abs(j - k), j))
