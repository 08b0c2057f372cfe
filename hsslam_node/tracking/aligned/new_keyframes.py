"""Decides which frames become keyframes, and appends them to the store."""

from typing import NamedTuple

import numpy as np

from hsslam_node.config import SlamConfig
from hsslam_node.frame import Frame
from hsslam_node.geometry.pose_covariance import UNTRACKED, turned
from hsslam_node.map.store import KeyframeStore
from hsslam_node.place_recognition.still_camera import StillCamera
from hsslam_node.tracking.aligned.acceptance import is_left_behind
from hsslam_node.tracking.aligned.observation import Observation
from hsslam_node.tracking.aligned.reference_aligner import PoseDoubt, ReferenceAligner
from hsslam_node.tracking.alignment.align import Alignment
from hsslam_node.tracking.dynamic_mask import DynamicMask
from hsslam_node.tracking.tracked_frame import JoinedFragment

_FEWEST_BETWEEN = 2  # frames from keyframe to keyframe, also if the view changes fast


class NewKeyframe(NamedTuple):
    """A frame that has become a keyframe."""

    id: int
    T_world_cam: np.ndarray  # [4, 4]
    pose_version: int
    frame: Frame  # without moving objects


class NewKeyframes:
    """Counts frames since the newest keyframe, and appends to the store."""

    def __init__(self, config: SlamConfig, store: KeyframeStore) -> None:
        self._config = config
        self._store = store
        self._dynamic = DynamicMask(store)
        self._still = StillCamera(store, config.keyframes.still)
        self.spacing = 1  # times the configured number of frames between keyframes
        self.frames_since = 0
        self.fragment = 0  # of new keyframes

    @property
    def is_late(self) -> bool:
        """Whether the next keyframe is due by the number of frames."""
        return self.frames_since >= self.spacing * self._config.keyframes.every_frames

    def is_due(
        self, seen: Observation, alignment: Alignment, T_world_cam: np.ndarray, coverage: float,
        *, has_gap: bool,
    ) -> bool:  # fmt: skip
        """Whether a frame becomes a keyframe: the map grows, there is room, and the camera moves.

        coverage: largest share of a frame's points that have met the reference's surface.
        has_gap: whether it was not tracked all the way from the newest keyframe.
        """
        if seen.localise_only:
            return False
        is_left = self.frames_since >= _FEWEST_BETWEEN and is_left_behind(
            alignment, coverage, self._config.tracker
        )
        if not (is_left or self.is_late) or not self._store.has_room(has_gap=has_gap):
            return False
        coarse = seen.levels[0]
        return not self._still.has_enough(T_world_cam, coarse.grey, coarse.depth) or is_left

    def append(
        self,
        frame: Frame,
        alignment: Alignment,
        aligner: ReferenceAligner,
        doubt: PoseDoubt,
        gap: np.ndarray,
    ) -> NewKeyframe:
        """Append a frame at the pose of its newest alignment.

        gap: covariance [6, 6] of the motion by odometry alone since the newest keyframe.
        """
        self.frames_since = 0
        if aligner.take_untracked():
            gap = gap + UNTRACKED
        with self._store.appending():
            T, version = aligner.placed(alignment)
            still = self._dynamic.left_out(frame, T)
            gap_covariance = turned(gap + doubt.own, T[:3, :3].T) if gap.any() else gap
            covariance = doubt.of_new_keyframe()
            k = self._store.append(
                still, T, version, covariance, gap_covariance, self.fragment, aligner.aligned_to
            )
        self._dynamic.observe(k, still)
        return NewKeyframe(k, T, version, still)

    def begin(self, k: int, frame: Frame) -> None:
        """Take a frame that became keyframe k without alignment."""
        self.frames_since = 0
        self._dynamic.observe(k, frame)

    def take_over(self, other: "NewKeyframes", joined: JoinedFragment) -> None:
        """Continue from a fragment that has joined the store."""
        self.frames_since = other.frames_since
        self.fragment = joined.fragment
