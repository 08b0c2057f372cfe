"""Keyframes on the topic `out/keyframe`: new ones, and those that the map has from a fragment."""

import numpy as np

from hsslam_node.tracking.tracked_frame import JoinedFragment, TrackResult
from hsslam_proto import messages, topics
from hsslam_proto.pose_codec import wire_pose
from hsslam_services.arena.map_state import MapState
from hsslam_services.arena.shared_map import SharedMap
from hsslam_services.launch.worker import Worker


class KeyframesOut:
    """Announces keyframes at their poses of now."""

    def __init__(self, worker: Worker, link: SharedMap, mode: MapState) -> None:
        self._worker = worker
        self._link = link
        self._mode = mode
        self._keyframes = worker.bus.publisher(topics.KEYFRAME)

    def put(self, result: TrackResult, message: messages.Frame) -> None:
        """The frame of this result has become a keyframe."""
        self._put(result.keyframe, message.index, message.source_stamp_ns, result.T_world_cam)

    def put_joined(self, joined: JoinedFragment) -> None:
        """A fragment has joined the map."""
        store = self._link.store()
        assert store is not None
        ids = np.unique(joined.keyframes)
        frames, stamps_ns = store.frame_indices(), store.stamps_ns()
        for k, T in zip(ids.tolist(), store.poses_of(ids), strict=True):
            self._put(k, int(frames[k]), int(stamps_ns[k]), T, joined.fragment)
        self._worker.count("fragments joined")
        text = f"fragment {joined.fragment} has joined the map with {len(ids)} keyframes"
        self._worker.event("info", text)

    def _put(
        self, k: int, frame_index: int, stamp_ns: int, T_world_cam: np.ndarray, fragment: int = 0
    ) -> None:
        t, q = wire_pose(T_world_cam)
        keyframe = messages.Keyframe(
            id=k,
            frame_index=frame_index,
            source_stamp_ns=stamp_ns,
            t=t,
            q=q,
            map_epoch=self._mode.map_epoch,
            fragment=fragment,
        )
        self._keyframes.put(keyframe)
