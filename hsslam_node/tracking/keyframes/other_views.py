"""Depth of a keyframe, averaged over the keyframes near it that see the same surface."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.depth_noise import averaging_limit
from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse
from hsslam_node.kernels.tracking.view_mean import add_view
from hsslam_node.map.store import KeyframeStore, RetiredKeyframeError

_GATE = 2.0  # times the usual difference between pixels of one surface


@dataclass(frozen=True)
class OtherViews:
    """Depth images of other keyframes of the same camera. Without any, depth stays as it is."""

    T_view_key: tuple[np.ndarray, ...]  # n times [4, 4]
    depth_raw: tuple[np.ndarray, ...]  # n times [H, W] uint16
    K: np.ndarray  # [4] float64
    metres_per_unit: float
    gate: float  # 1/m, limit for inverse depths of one surface; 0: depth is not averaged

    def averaged(self, rays: np.ndarray, depth_m: np.ndarray, pixels: float) -> np.ndarray:
        """Depth [N] m along rays [N, 2] (x, y at z = 1, camera of the keyframe), averaged over all views.
        depth_m: [N] of the keyframe, each the mean of `pixels` pixels, 0 = unknown."""
        count = np.where(depth_m > 0, pixels, 0.0)
        total = np.divide(count, depth_m, out=np.zeros_like(count), where=depth_m > 0)
        if self.gate > 0:
            for T, raw in zip(self.T_view_key, self.depth_raw, strict=True):
                add_view(rays, T, raw, self.metres_per_unit, self.K, self.gate, total, count)
        return np.divide(count, total, out=np.zeros_like(count), where=total > 0)

    def __bool__(self) -> bool:
        return self.gate > 0 and len(self.depth_raw) > 0


def views_near(store: KeyframeStore, k: int, frame: Frame, most: int) -> OtherViews:
    """Views of up to `most` keyframes next to keyframe k, which is `frame`, at their current poses; none if
    its depth is exact or neighbouring pixels err alike."""
    c, gate = frame.camera, _GATE * averaging_limit(frame)
    near = [j for j in _next_to(k, most, store.count) if store.is_kept(j)][:most] if gate else []
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
    return OtherViews(tuple(T_view_key), tuple(depth), K, 1.0 / frame.depth_units_per_m, gate)


def _next_to(k: int, most: int, count: int) -> list[int]:
    """Ids below `count` at most `most` from k, the nearest first."""
    near = [j for j in range(max(k - most, 0), min(k + most + 1, count)) if j != k]
    return sorted(near, key=lambda j: (abs(j - k), j))
