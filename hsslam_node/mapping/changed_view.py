"""Whether a place has changed since earlier keyframes showed it; apart, as it knows no cells."""

import cv2
import numpy as np

from hsslam_node.geometry.projection import pixel_rays, project
from hsslam_node.geometry.se3 import inverse, transformed
from hsslam_node.geometry.view_distance import view_distance
from hsslam_node.map.store import KeyframeStore

_STRIDE = 8 / 640  # of the width of the image
_MARGIN_M, _MARGIN_SLOPE = 0.05, 0.01  # a surface is seen through from first + second z^2 on, m
_CHANGED_M2 = 0.015  # of surface; the same frames once more: less
_PATCH = np.ones((3, 3), np.uint8)  # samples that must all be seen through: edges are narrower
_NEAR, _NEAR_M = 1.5, 0.6  # a recent view is at most first x the nearest's distance + second away
_SHARED = 0.5  # of the samples, which it must have in view
ENOUGH_VIEWS = 6  # that agree on a change; the evidence of `distance/occupancy.py` needs as many


def has_changed(
    store: KeyframeStore, k: int, earlier: np.ndarray, later: np.ndarray | None = None
) -> bool:
    """Whether keyframe k sees through surface that keyframes of `earlier` [n], the oldest first, show, or
    shows surface that these see through; 4 ms.

    Three of them answer: of the near views the newest and the sixth newest, so that a change counts until six
    views show it; and the nearest, for what the sixth did not measure. A change does not count if it is
    undone in the newest near view among `later` [m]: a person who walks by changes nothing.

    Raises:
        RetiredKeyframeError: one of them is not kept.
    """
    T_world_cam = store.pose(k)
    away = view_distance(T_world_cam, store.poses_of(earlier))
    nearest, near = int(earlier[away.argmin()]), _NEAR * away.min() + _NEAR_M
    recent = recent_views(store, k, earlier[away <= near], ENOUGH_VIEWS)
    newer = [j for j in recent[ENOUGH_VIEWS - 1 :] if j > nearest]
    asked = {nearest: newer} | {j: [] for j in (*recent[:1], *recent[-1:])}
    if later is not None:
        later = later[view_distance(T_world_cam, store.poses_of(later)) <= near]
    last = [] if later is None else recent_views(store, k, later, 1)
    return any(
        _seen_through_m2(store, shown_by, seen_by, but, last) >= _CHANGED_M2
        for j, but in asked.items()
        for shown_by, seen_by in ((j, k), (k, j))
    )


def recent_views(store: KeyframeStore, k: int, near: np.ndarray, most: int) -> list[int]:
    """Up to `most` of the keyframes `near` that have half of the samples of k in view, the newest first."""
    points, _, known = _samples(store, k)
    recent: list[int] = []
    for j in reversed(near.tolist()):
        if np.mean(np.isfinite(_behind(store, points, j)[known])) > _SHARED:
            recent.append(j)
            if len(recent) == most:
                break
    return recent


def _seen_through_m2(
    store: KeyframeStore, shown_by: int, seen_by: int, but: list[int], last: list[int]
) -> float:
    """Area of the coherent surface of one keyframe that another sees through, m2: without what those of `but`
    measured there or behind it, and without what has come back or gone again in those of `last`."""
    points, depth_m, known = _samples(store, shown_by)
    is_gone = known & (_behind(store, points, seen_by) > 1)
    for j in but:
        is_gone &= ~(_behind(store, points, j) > -1)
    for j in last:
        behind = _behind(store, points, j)
        is_gone &= ~((np.abs(behind) <= 1) if shown_by < seen_by else (behind > 1))
    patches = cv2.morphologyEx(is_gone.astype(np.uint8), cv2.MORPH_OPEN, _PATCH)
    sample_m2 = (_stride_px(store) / store.camera.fx * depth_m) ** 2
    return float(np.sum(sample_m2[patches > 0]))


def _samples(store: KeyframeStore, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points [h, w, 3] m in the world of every `_stride_px`-th pixel, their depth and whether it is known."""
    stride_px = _stride_px(store)
    depth_m = store.pixels(k)[1][::stride_px, ::stride_px] / store.depth_units_per_m
    v, u = stride_px * np.indices(depth_m.shape)
    points = pixel_rays(u, v, store.camera) * depth_m[..., None]
    return transformed(store.pose(k), points), depth_m, depth_m > 0


def _behind(store: KeyframeStore, points: np.ndarray, seen_by: int) -> np.ndarray:
    """How far behind points [h, w, 3] a keyframe measured surface, [h, w] margins; nan: it measured none."""
    camera = store.camera
    u, v, z = project(points.reshape(-1, 3), camera, inverse(store.pose(seen_by)))
    u, v = np.round(u).astype(int), np.round(v).astype(int)
    inside = (z > 0.1) & (u >= 0) & (v >= 0) & (u < camera.width_px) & (v < camera.height_px)
    z = z[inside]
    depth_m = store.pixels(seen_by)[1][v[inside], u[inside]] / store.depth_units_per_m
    behind = np.full(len(inside), np.nan)
    behind[inside] = (depth_m - z) / np.where(depth_m > 0, _MARGIN_M + _MARGIN_SLOPE * z**2, np.nan)
    return behind.reshape(points.shape[:-1])


def _stride_px(store: KeyframeStore) -> int:
    return max(1, round(_STRIDE * store.camera.width_px))
