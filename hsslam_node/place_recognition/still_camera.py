"""A camera that stands still adds no keyframes once the map has enough of its view."""

import numpy as np

from hsslam_node.geometry.se3 import inverse, so3_log
from hsslam_node.map.store import KeyframeStore

_STILL_M, _STILL_RAD = 0.01, 0.009  # from where it came to rest: several times the noise of poses
# mean difference of coarse images, of 255; more: the light changed, or a person came
_SAME_GREY = 6.0


class StillCamera:
    """Counts keyframes of one view: same place, same picture."""

    def __init__(self, store: KeyframeStore, keyframes: int) -> None:
        self._store = store
        self._most = keyframes
        self._first: tuple[int, np.ndarray] | None = None  # first of this view, and its picture
        self._keyframes = 0

    def has_enough(self, T_world_cam: np.ndarray, grey: np.ndarray) -> bool:
        """Whether there are enough keyframes of the view at T_world_cam [4, 4].

        If not, the caller appends one now. `grey`: its coarse image [h, w] float32, 0 to 255.
        """
        if self._is_as_before(T_world_cam, grey):
            self._keyframes += 1
            return self._keyframes > self._most
        self._first, self._keyframes = (self._store.count, grey), 1
        return False

    def _is_as_before(self, T_world_cam: np.ndarray, grey: np.ndarray) -> bool:
        if self._first is None:
            return False
        k, picture = self._first
        step = inverse(self._store.pose(k)) @ T_world_cam
        return bool(
            np.linalg.norm(step[:3, 3]) < _STILL_M
            and np.linalg.norm(so3_log(step[:3, :3])) < _STILL_RAD
            and np.abs(grey - picture).mean() < _SAME_GREY
        )
