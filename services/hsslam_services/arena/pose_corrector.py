"""Writes corrected poses to the keyframes and publishes them."""

from typing import Protocol

import numpy as np

from hsslam_node.geometry.se3_batch import quaternions_from_rotations
from hsslam_node.map.store import KeyframeStore
from hsslam_proto.messages import Correction
from hsslam_services.arena.map_state import MapState

_MOST_A_MESSAGE = 8192  # keyframes: 0.6 MB
_LEAST_M, _LEAST_RAD = 1e-3, 1e-3  # of a motion that is published at once
_GROWTH = 1.5  # of the number of keyframes, from one message with all poses to the next
_UNKNOWN = np.float32(np.inf)


class Publisher(Protocol):
    """Publisher of the topic `out/correction`."""

    def put(self, message: Correction, /) -> object: ...


class PoseCorrector:
    """Corrects keyframe poses. If two processes do so, each holds the map's lease in `correct`.

    A round of bundle adjustment can move every keyframe of a run, most of them by less than a millimetre.
    These poses are published only when the number of keyframes has grown by half, and by `publish_all`.
    Otherwise the log would grow with the square of time.
    """

    def __init__(self, publisher: Publisher, mode: MapState) -> None:
        self._publisher = publisher
        self._mode = mode
        # t and q of each keyframe, inf: not known to be published
        self._published = np.empty((0, 7), np.float32)
        self._map_epoch = mode.map_epoch
        self._version = 0  # of the poses that this process left
        self._all_at = 0  # keyframes when all poses were published
        self._losses = 0.0, 0.0

    def correct(
        self,
        store: KeyframeStore,
        keyframes: np.ndarray,
        T_world_cam: np.ndarray,
        known: int | None,
        losses: tuple[float, float],
        loops: list[tuple[int, int]] | None = None,
        T_then: np.ndarray | None = None,
    ) -> None:
        """Call `KeyframeStore.correct_poses`; publish the poses that have moved by more than 1 mm or 1 mrad
        since they were last published. `losses`: before and after; `loops`: closed pairs."""
        base, self._losses = store.pose_version, losses
        if self._map_epoch != self._mode.map_epoch:
            self._map_epoch, self._all_at = self._mode.map_epoch, 0
        elif base != self._version:  # another process has corrected poses
            self._published = self._published[:0]
        moved = store.correct_poses(keyframes, T_world_cam, known, T_then)
        self._version = moved.version
        pairs = [(min(pair), max(pair)) for pair in loops or []]
        if store.count >= _GROWTH * self._all_at:
            self._publish_all(store, (base, moved.version), pairs)
        else:
            pose = _t_and_q(moved.T_world_cam)
            is_news = self._is_news(moved.keyframes, pose)
            self._publish(moved.keyframes[is_news], pose[is_news], (base, moved.version), pairs)

    def publish_all(self, store: KeyframeStore) -> None:
        """Publish the present poses of all keyframes, if a process has corrected some; hold the lease as in
        `correct`."""
        if version := store.pose_version:
            self._map_epoch = self._mode.map_epoch
            self._publish_all(store, (version, version), [])

    def _publish_all(
        self, store: KeyframeStore, versions: tuple[int, int], loops: list[tuple[int, int]]
    ) -> None:
        poses = store.poses()
        self._all_at = len(poses)
        self._published = np.empty((len(poses), 7), np.float32)
        self._publish(np.arange(len(poses)), _t_and_q(poses), versions, loops)

    def _is_news(self, ids: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """Whether keyframes `ids` [n] have moved, to `pose` [n, 7], since they were published, [n] bool."""
        unknown = max(int(ids.max(initial=-1)) + 1 - len(self._published), 0)
        self._published = np.concatenate([self._published, np.full((unknown, 7), _UNKNOWN)])
        off = pose - self._published[ids]
        has_moved = np.linalg.norm(off[:, :3], axis=1) > _LEAST_M
        return has_moved | (2 * np.linalg.norm(off[:, 3:], axis=1) > _LEAST_RAD)

    def _publish(
        self,
        ids: np.ndarray,
        pose: np.ndarray,
        versions: tuple[int, int],
        loops: list[tuple[int, int]],
    ) -> None:
        """Publish poses [n, 7] of keyframes `ids` [n]; `versions`: before and now."""
        self._published[ids] = pose
        for first in range(0, max(len(ids), 1), _MOST_A_MESSAGE):
            part = slice(first, first + _MOST_A_MESSAGE)
            self._publisher.put(
                Correction(
                    pose_version=versions[1],
                    base_version=versions[0],
                    keyframes=ids[part].tolist(),
                    t=[(x, y, z) for x, y, z in pose[part, :3].tolist()],
                    q=[(x, y, z, w) for x, y, z, w in pose[part, 3:].tolist()],
                    loss_before=self._losses[0],
                    loss_after=self._losses[1],
                    loops=loops if first == 0 else [],
                    map_epoch=self._map_epoch,
                )
            )


def _t_and_q(T_world_cam: np.ndarray) -> np.ndarray:
    """Positions and quaternions (xyzw) of poses [n, 4, 4], [n, 7] float64."""
    q = quaternions_from_rotations(T_world_cam[:, :3, :3])
    return np.concatenate([T_world_cam[:, :3, 3], q], axis=1)
