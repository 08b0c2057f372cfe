"""Writes corrected poses to the keyframes and tells the other processes of them."""

from typing import Protocol

import numpy as np

from hsslam_node.map.store import KeyframeStore
from hsslam_proto.messages import Correction
from hsslam_proto.pose_codec import wire_pose
from hsslam_services.arena.map_state import MapState


class Publisher(Protocol):
    """Of the topic `out/correction`."""

    def put(self, message: Correction, /) -> object: ...


class PoseCorrector:
    """One a process. Where two processes correct poses, each holds the map's lease meanwhile."""

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
    ) -> None:
        """As `KeyframeStore.correct_poses`; `losses`: before and after, `loops`: closed, for the message."""
        base = store.pose_version
        moved = store.correct_poses(keyframes, T_world_cam, known)
        poses = [wire_pose(T) for T in moved.T_world_cam]
        self._publisher.put(
            Correction(
                pose_version=moved.version,
                base_version=base,
                keyframes=[int(k) for k in moved.keyframes],
                t=[t for t, _ in poses],
                q=[q for _, q in poses],
                loss_before=losses[0],
                loss_after=losses[1],
                loops=[(min(pair), max(pair)) for pair in loops or []],
                map_epoch=self._mode.map_epoch,
            )
        )
