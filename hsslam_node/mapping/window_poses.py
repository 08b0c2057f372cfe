"""Poses that mapping refines together with the map (paper III-B)."""

from typing import NamedTuple

import numpy as np

from hsslam_node.geometry.pose_adam import PoseAdam
from hsslam_node.geometry.se3 import moved_about_camera
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.map_optimiser import ADAM_BETA1

_LEAST_KEYFRAMES = 5  # as in ESLAM: fewer views would pull poses to a map that hardly fits


class RefinedPoses(NamedTuple):
    """For `KeyframeStore.correct_poses`."""

    keyframes: np.ndarray  # [n] ids, sorted
    T_world_cam: np.ndarray  # [n, 4, 4]
    known: int  # number of keyframes at that time


class WindowPoses:
    """Poses that iterations have refined, until `take` returns them.

    All poses of a window are free but that of its oldest keyframe. Each keyframe keeps its Adam moments, as
    windows differ from one iteration to the next.
    """

    def __init__(self, rate: float) -> None:
        self._rate = rate  # m and rad
        self._refined: dict[int, np.ndarray] = {}
        self._moments: dict[int, PoseAdam] = {}
        self._known = 0

    def are_free(self, store: KeyframeStore) -> bool:
        """Whether iterations refine poses now."""
        return self._rate > 0 and store.count >= _LEAST_KEYFRAMES

    def of(self, store: KeyframeStore, keyframes: np.ndarray) -> np.ndarray:
        """T_world_cam [n, 4, 4] of `keyframes` [n] as refined so far."""
        poses = store.poses_of(keyframes)
        for slot, k in enumerate(keyframes.tolist()):
            poses[slot] = self._refined.get(k, poses[slot])
        return poses

    def step(
        self, store: KeyframeStore, keyframes: np.ndarray, poses: np.ndarray, gradient: np.ndarray
    ) -> None:
        """Move `keyframes` [n] from `poses` [n, 4, 4] against `gradient` [n, 6] by a world-side twist."""
        self._known = store.count
        for slot, k in enumerate(keyframes.tolist()):
            if k != keyframes.min():
                moments = self._moments.setdefault(k, PoseAdam(ADAM_BETA1))
                twist = moments.step(gradient[slot], self._rate)
                self._refined[k] = moved_about_camera(poses[slot], twist)

    def take(self, store: KeyframeStore) -> RefinedPoses | None:
        """The poses refined since the last call, for the caller to write to the store, or None."""
        if not self._refined:
            return None
        ids = np.array(sorted(self._refined), np.int64)
        poses = np.stack([self._refined[k] for k in ids.tolist()])
        self._refined = {}
        self._moments = {k: moments for k, moments in self._moments.items() if store.is_kept(k)}
        return RefinedPoses(ids, poses, self._known)
