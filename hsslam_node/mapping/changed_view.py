"""Whether a place has changed since a keyframe of a saved map showed it; apart, as it knows no cells."""

import numpy as np

from hsslam_node.geometry.projection import project, world_points
from hsslam_node.geometry.se3 import inverse
from hsslam_node.geometry.view_distance import view_distance
from hsslam_node.map.store import KeyframeStore

_STRIDE = 24 / 640  # of the width of the image
_MARGIN_M, _MARGIN_SLOPE = 0.05, 0.02  # a surface is seen through from first + second z^2 on, m
_CHANGED = 0.03  # share of the points; the same frames once more: at most 0.01


def has_changed(store: KeyframeStore, k: int, earlier: np.ndarray) -> bool:
    """Whether keyframe k sees through surface that the one of `earlier` [n] with the nearest view shows, or
    shows surface that this one sees through; 2 ms.

    Raises:
        RetiredKeyframeError: one of the two is not kept.
    """
    poses = store.poses_of(earlier)
    nearest = int(view_distance(store.pose(k), poses).argmin())
    j = int(earlier[nearest])
    return max(_seen_through(store, j, k), _seen_through(store, k, j)) > _CHANGED


def _seen_through(store: KeyframeStore, shown_by: int, seen_by: int) -> float:
    """Share of the surface of one keyframe, as far as the other looks there, that this one sees through."""
    camera, units_per_m = store.camera, store.depth_units_per_m
    stride_px = max(1, round(_STRIDE * camera.width_px))
    depth_m = store.pixels(shown_by)[1] / units_per_m
    points = world_points(depth_m, camera, store.pose(shown_by), stride_px)
    u, v, z = project(points, camera, inverse(store.pose(seen_by)))
    u, v = np.round(u).astype(int), np.round(v).astype(int)
    inside = (z > 0.1) & (u >= 0) & (v >= 0) & (u < camera.width_px) & (v < camera.height_px)
    u, v, z = u[inside], v[inside], z[inside]
    behind_m = store.pixels(seen_by)[1][v, u] / units_per_m - z
    return float(np.mean(behind_m > _MARGIN_M + _MARGIN_SLOPE * z**2)) if len(z) else 0.0
