"""Writes corrected poses to the keyframes and publishes them."""

from typing import Protocol

import numpy as np

from hsslam_node.geometry.se3_batch import quaternions_from_rotations
from hsslam_node.map.store import KeyframeStore
from hsslam_proto.messages import Correction
from hsslam_services.arena.map_state import MapState

_MOST_A_MESSAGE = 8192  # keyframes: 0.6 MB


class Publisher(Protocol):
    """Publisher of the topic `out/correction`."""

    def put(self, message: Correction, /) -> object: ...


class PoseCorrector:
    """Corrects keyframe poses. If two processes do so, each holds the map's lease in `correct`."""

    def __init__(self, publisher: Publisher, mode: MapState) -> None:
        self._publisher = publisher
        self._mode = mode

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
        """Call `KeyframeStore.correct_poses`, publish; `losses`: before and after, `loops`: closed pairs."""
        base = store.pose_version
        moved = store.correct_poses(keyframes, T_world_cam, known, T_then)
        t = moved.T_world_cam[:, :3, 3]
        q = quaternions_from_rotations(moved.T_world_cam[:, :3, :3])
        for first in range(0, max(len(moved.keyframes), 1), _MOST_A_MESSAGE):
            part = slice(first, first + _MOST_A_MESSAGE)
            self._publisher.put(
                Correction(
                    pose_version=moved.version,
                    base_version=base,
                    keyframes=moved.keyframes[part].tolist(),
                    t=[(x, y, z) for x, y, z in t[part].tolist()],
                    q=[(x, y, z, w) for x, y, z, w in q[part].tolist()],
                    loss_before=losses[0],
                    loss_after=losses[1],
                    loops=[(min(pair), max(pair)) for pair in loops or []] if first == 0 else [],
                    map_epoch=self._mode.map_epoch,
                )
            )
