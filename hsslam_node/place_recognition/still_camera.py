"""A camera that stands still adds no keyframes once the map has enough of its view."""

from typing import NamedTuple

import cv2
import numpy as np

from hsslam_node.geometry.se3 import inverse, so3_log
from hsslam_node.map.store import KeyframeStore

_STILL_M, _STILL_RAD = 0.01, 0.009  # from where it came to rest: several times the noise of poses
# mean difference of coarse images, of 255; more: the light changed, or a person came
_SAME_GREY = 6.0
# of depth: something was put there or taken away. Alone, pixels on edges change without it
_SAME_M, _SAME_PER_M2 = 0.05, 0.01
_CHANGED_SHARE = 0.005  # of the pixels, whose eight neighbours have changed too


class _Picture(NamedTuple):
    """The first keyframe of a view, and its coarse images [h, w]."""

    keyframe: int
    grey: np.ndarray
    depth_m: np.ndarray


class StillCamera:
    """Counts keyframes of one view: same place, same picture, same surfaces."""

    def __init__(self, store: KeyframeStore, keyframes: int) -> None:
        self._store = store
        self._most = keyframes
        self._first: _Picture | None = None  # of this view
        self._keyframes = 0

    def has_enough(self, T_world_cam: np.ndarray, grey: np.ndarray, depth_m: np.ndarray) -> bool:
        """Whether there are enough keyframes of the view at T_world_cam [4, 4].

        If not, the caller appends one now. Its coarse images [h, w] float32: `grey` 0 to 255, `depth_m` with
        0 for unknown.
        """
        picture = _Picture(self._store.count, grey, depth_m)
        if self._is_as_before(T_world_cam, picture):
            self._keyframes += 1
            return self._keyframes > self._most
        self._first, self._keyframes = picture, 1
        return False

    def _is_as_before(self, T_world_cam: np.ndarray, now: _Picture) -> bool:
        first = self._first
        if first is None:
            return False
        step = inverse(self._store.pose(first.keyframe)) @ T_world_cam
        return bool(
            np.linalg.norm(step[:3, 3]) < _STILL_M
            and np.linalg.norm(so3_log(step[:3, :3])) < _STILL_RAD
            and np.abs(now.grey - first.grey).mean() < _SAME_GREY
            and not _has_changed(now.depth_m, first.depth_m)
        )


def _has_changed(depth_m: np.ndarray, before_m: np.ndarray) -> bool:
    """Whether a surface lies elsewhere than before, in some part of the image."""
    is_known = (depth_m > 0) & (before_m > 0)
    is_other = is_known & (np.abs(depth_m - before_m) > _SAME_M + _SAME_PER_M2 * before_m**2)
    whole = cv2.erode(is_other.astype(np.uint8), np.ones((3, 3), np.uint8))
    return cv2.countNonZero(whole) > _CHANGED_SHARE * whole.size
