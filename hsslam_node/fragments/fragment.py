"""A fragment: what a camera that is lost to the map sees, in a coordinate frame of its own."""

import numpy as np

from hsslam_node.config import SlamConfig
from hsslam_node.frame import Frame
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.tracking.tracked_frame import JoinedFragment, TrackResult
from hsslam_node.tracking.tracker import Tracker

# covariances, m and rad: of the pose that a join gives, and of the motion between map and fragment until
# bundle adjustment has aligned the two
_UNSURE = np.diag(np.repeat([0.02**2, 0.01**2], 3))
_GAP = np.diag(np.repeat([0.1**2, 0.05**2], 3))


class Fragment:
    """Keyframes in memory of this process, and a tracker that aligns frames to them alone.

    No field is fitted to them, and no other process sees them before they join the map.
    """

    def __init__(self, config: SlamConfig, first: Frame, seed: int, number: int, most: int) -> None:
        """`most`: keyframes that it may have; then it is tracked on those that there are."""
        self.number = number
        self.store = KeyframeStore.create(
            MemoryAllocator(), first.camera, first.depth_units_per_m, most
        )
        self.tracker = Tracker(config, self.store, seed)

    def track(self, frame: Frame) -> TrackResult:
        """The pose in the fragment."""
        return self.tracker.track(frame, None)

    def join(
        self, store: KeyframeStore, T_map_fragment: np.ndarray, room: int
    ) -> JoinedFragment | None:
        """Append the keyframes to the map's `store`, at most `room` of them, the others left out evenly.

        None, and nothing is appended, if there is no room for those that the tracker needs.
        """
        count, held = self.store.count, self.tracker.held_keyframes
        every = -(-count // max(room - len(held), 1))
        chosen = sorted({*range(0, count, every), *held})
        if len(chosen) > room:
            return None
        poses = self.store.poses()
        ids = np.full(count, -1, np.int64)
        for k in chosen:
            if not store.has_room():  # of memory; the keyframes before stand for it
                continue
            with store.appending():
                ids[k] = store.append(
                    self.store.frame(k), T_map_fragment @ poses[k], None,
                    self.store.covariance(k) + _UNSURE,
                    self.store.gap_covariance(k) if (ids >= 0).any() else _GAP, self.number,
                )  # fmt: skip
        return _joined(self.number, ids, poses)


def _joined(number: int, ids: np.ndarray, poses: np.ndarray) -> JoinedFragment | None:
    """Keyframes without an id move with the last one before them that has one, or with the first."""
    has_id = np.flatnonzero(ids >= 0)
    if len(has_id) == 0:
        return None
    at = np.clip(np.searchsorted(has_id, np.arange(len(ids)), side="right") - 1, 0, None)
    anchor = has_id[at]
    T_keyframe_own = np.linalg.inv(poses[anchor]) @ poses
    T_keyframe_own[has_id] = np.eye(4)
    return JoinedFragment(number, ids[anchor], T_keyframe_own)
