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
        """The pose in the store, and the version that has it."""
        return cls(keyframe, *store.pose_at(keyframe))

    def followed(self, T: np.ndarray, store: KeyframeStore) -> tuple[np.ndarray, int]:
        """An aligned pose [4, 4], moved with the reference if it was corrected, and the pose version."""
        T_world_ref, newest = store.pose_at(self.keyframe)
        if newest == self.pose_version or (T_world_ref == self.T_world_ref).all():
            return T, newest
        return orthonormal(T_world_ref @ inverse(self.T_world_ref) @ T), newest
