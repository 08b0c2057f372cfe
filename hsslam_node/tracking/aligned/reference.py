"""The reference keyframe, with exposure and coverage of the frames that were aligned to it."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.config import TrackerConfig
from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse
from hsslam_node.map.store import KeyframeStore
from hsslam_node.tracking.aligned.acceptance import needs_replacing, reference_overlap
from hsslam_node.tracking.alignment.align import Alignment
from hsslam_node.tracking.alignment.frame_terms import Exposure
from hsslam_node.tracking.keyframes.reference_keyframe import ReferenceKeyframe
from hsslam_node.tracking.tracked_frame import orthonormal

_SAME = Exposure()


@dataclass(frozen=True)
class Reference:
    """The reference keyframe, and results of alignments to it."""

    keyframe: ReferenceKeyframe
    exposure: Exposure = _SAME  # of the last good frame against the keyframe
    coverage: float = 0.0  # largest share of a frame's depth points on the keyframe's surface
    # whether the camera was not tracked to it from the newest keyframe, until the next keyframe comes
    is_at_place: bool = False

    def needs_replacing(
        self, alignment: Alignment, T: np.ndarray, frame: Frame, store: KeyframeStore, config: TrackerConfig
    ) -> bool:  # fmt: skip
        """Whether another keyframe would show more of a frame that was aligned at T [4, 4]."""
        T_cam_ref = inverse(T) @ store.pose(self.keyframe.id)
        overlap = reference_overlap(self.keyframe, T_cam_ref, frame.camera)
        return needs_replacing(alignment, overlap, self.coverage, config)


@dataclass(frozen=True)
class AlignedAt:
    """The reference's pose during an alignment; bundle adjustment may correct it meanwhile."""

    keyframe: int
    T_world_ref: np.ndarray  # [4, 4]
    pose_version: int

    @classmethod
    def now(cls, keyframe: int, store: KeyframeStore) -> "AlignedAt":
        """The pose in the store; the version is read first, so that a correction in between is noticed."""
        version = store.pose_version
        return cls(keyframe, store.pose(keyframe), version)

    def followed(self, T: np.ndarray, store: KeyframeStore) -> tuple[np.ndarray, int]:
        """An aligned pose [4, 4], moved with the reference if it was corrected, and the pose version."""
        newest = store.pose_version
        if newest == self.pose_version:
            return T, newest
        now, then = store.pose(self.keyframe), self.T_world_ref
        return (T if (now == then).all() else orthonormal(now @ inverse(then) @ T)), newest
