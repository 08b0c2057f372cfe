"""Finds the keyframe of a map that shows most of a frame."""

import numpy as np

from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import project, world_points
from hsslam_node.geometry.se3 import inverse
from hsslam_node.geometry.view_distance import view_distance
from hsslam_node.map.store import KeyframeStore, RetiredKeyframeError

_STRIDE = 24 / 640  # of the width of the image
_CANDIDATES = 12  # keyframes with the nearest views
_MARGIN_M, _MARGIN_SLOPE = 0.03, 0.02  # two depths within first + second z, m, are one surface
_CLEARLY = 0.1  # share of the frame's points that it must show more than the current one


def covering_keyframe(
    store: KeyframeStore, frame: Frame, T_world_cam: np.ndarray, current: int
) -> int:
    """The keyframe on whose surface most of the frame's depth lies; `current` unless one is clearly better.

    Of equals, it is the one with the view nearest to T_world_cam [4, 4].
    """
    depth_m = frame.depth_raw / frame.depth_units_per_m
    points = world_points(depth_m, frame.camera, T_world_cam, stride_px(frame.camera))
    if len(points) == 0:
        return current
    ids = store.kept()
    poses = store.poses_of(ids)
    away = view_distance(T_world_cam, poses)
    best, most = current, share_shown(store, current, store.pose(current), points) + _CLEARLY
    for i in np.argsort(away, kind="stable")[:_CANDIDATES]:
        k = int(ids[i])
        share = share_shown(store, k, poses[i], points)
        if k != current and share > most:
            best, most = k, share
    return best


def stride_px(camera: Camera) -> int:
    """Distance between the pixels whose points go to `share_shown`, along rows and columns."""
    return max(1, round(_STRIDE * camera.width_px))


def share_shown(store: KeyframeStore, k: int, T_world_key: np.ndarray, points: np.ndarray) -> float:
    """Share of the points [N, 3] that lie on the surface that keyframe k shows."""
    camera = store.camera
    u, v, z = project(points, camera, inverse(T_world_key))
    u, v = np.round(u).astype(int), np.round(v).astype(int)
    inside = (z > 0.1) & (u >= 0) & (v >= 0) & (u < camera.width_px) & (v < camera.height_px)
    try:
        depth_raw = store.pixels(k)[1][v[inside], u[inside]]
    except RetiredKeyframeError:
        return 0.0
    gap = np.abs(depth_raw / store.depth_units_per_m - z[inside])
    return float(((depth_raw > 0) & (gap < _MARGIN_M + _MARGIN_SLOPE * z[inside])).sum()) / len(z)
