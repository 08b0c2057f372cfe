"""Publishes keyframes on the topic `out/keyframe`: new ones, and those of a fragment that joins the map."""

import msgspec
import numpy as np

from hsslam_node.tracking.tracked_frame import JoinedFragment, TrackResult
from hsslam_proto import messages, topics
from hsslam_proto.pose_codec import wire_pose
from hsslam_services.arena.map_state import MapState
from hsslam_services.arena.shared_map import SharedMap
from hsslam_services.launch.worker import Worker


class KeyframesOut:
    """Publishes keyframes with their current poses."""

    def __init__(self, worker: Worker, link: SharedMap, mode: MapState) -> None:
        self._worker = worker
        self._link = link
        self._mode = mode
        self._keyframes = worker.bus.publisher(topics.KEYFRAME)

    def put(self, result: TrackResult, message: messages.Frame) -> None:
        """Publish the frame of this result as a new keyframe."""
        keyframe = self._message(
            result.keyframe, message.index, message.source_stamp_ns, result.T_world_cam
        )
        self._keyframes.put(keyframe)

    def put_joined(self, joined: JoinedFragment) -> None:
        """Publish the keyframes of a fragment that has joined the map."""
        store = self._link.store()
        assert store is not None
        ids, first = np.unique(joined.keyframes, return_index=True)
        frames, stamps_ns = store.frame_indices(), store.stamps_ns()
        for k, own, T in zip(ids.tolist(), first.tolist(), store.poses_of(ids), strict=True):
            t, q = wire_pose(joined.T_fragment_keyframe[own])
            keyframe = msgspec.structs.replace(
                self._message(k, int(frames[k]), int(stamps_ns[k]), T),
                fragment=joined.fragment,
                fragment_keyframe=own,
                t_in_fragment=t,
                q_in_fragment=q,
            )
            self._keyframes.put(keyframe)
        self._worker.count("fragments joined")
        text = f"fragment {joined.fragment} has joined the map with {len(ids)} keyframes"
        self._worker.event("info", text)

    def _message(
        self, k: int, frame_index: int, stamp_ns: int, T_world_cam: np.ndarray
    ) -> messages.Keyframe:
        t, q = wire_pose(T_world_cam)
        return messages.Keyframe(
            id=k,
            frame_index=frame_index,
            source_stamp_ns=stamp_ns,
            t=t,
            q=q,
            map_epoch=self._mode.map_epoch,
        )
