"""Keeps the reference keyframe, aligns frames to it and to the map, and chooses the next reference."""

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hsslam_node.config import TrackerConfig
from hsslam_node.frame import Frame
from hsslam_node.geometry.pose_covariance import in_world, of_new_keyframe
from hsslam_node.geometry.se3 import inverse
from hsslam_node.map.store import KeyframeStore, RetiredKeyframeError
from hsslam_node.tracking.aligned.observation import Observation
from hsslam_node.tracking.aligned.reference import AlignedAt, Reference
from hsslam_node.tracking.alignment.align import Alignment, align
from hsslam_node.tracking.keyframes.covering_keyframe import covering_keyframe
from hsslam_node.tracking.keyframes.other_views import OtherViews, views_near
from hsslam_node.tracking.keyframes.reference_keyframe import (
    PyramidLevel,
    ReferenceKeyframe,
    grey_pyramid,
    reference_keyframe,
    stored_reference,
)
from hsslam_node.tracking.tracked_frame import JoinedFragment, orthonormal


@dataclass(frozen=True)
class PoseDoubt:
    """Covariances of an aligned pose, as in `geometry/pose_covariance.py`."""

    own: np.ndarray  # [6, 6] of the pose against the reference
    of_reference: np.ndarray  # [6, 6]
    lever_m: np.ndarray  # [3] from the reference to the camera

    def in_world(self) -> np.ndarray:
        """[6, 6] of the pose in the world."""
        return in_world(self.own, self.of_reference, self.lever_m)

    def of_new_keyframe(self) -> np.ndarray:
        """[6, 6] of the pose in the world once the frame is a keyframe."""
        return of_new_keyframe(self.own, self.of_reference, self.lever_m)


class ReferenceAligner:
    """Keeps the keyframe that frames are aligned to, and aligns them."""

    def __init__(self, config: TrackerConfig, store: KeyframeStore) -> None:
        self._config = config
        self._store = store
        self._aligned_at: AlignedAt | None = None  # of the newest alignment
        self._next: Callable[[], Reference] | None = None
        self.reference: Reference | None = None

    @property
    def keyframe(self) -> int:
        """Id of the reference keyframe."""
        assert self.reference is not None
        return self.reference.keyframe.id

    @property
    def averaging(self) -> float | None:
        """The `averaging_limit` of the reference keyframe, 1/m; None without one."""
        return self.reference.keyframe.averaging_limit if self.reference else None

    def align(
        self, seen: Observation, T: np.ndarray, doubt: np.ndarray | None = None
    ) -> Alignment | None:
        """Align the frame from a guess T [4, 4]; None if it has too little depth.

        `doubt`: covariance [6, 6] of the guess if it is by odometry, see `with_motion_prior`.

        Raises:
            TornMapError: the map was overwritten meanwhile.
        """
        if not seen.has_depth or self.reference is None:
            return None
        reference = self.reference
        self._aligned_at = AlignedAt.now(reference.keyframe.id, self._store)
        found = align(
            seen.points, seen.levels, T, seen.view, reference.keyframe, self._aligned_at.T_world_ref,
            self._config, reference.exposure, doubt,
        )  # fmt: skip
        if seen.view is not None:
            seen.view.expect_intact()
        return found

    @property
    def aligned_to(self) -> int:
        """The keyframe to which the newest frame was aligned."""
        assert self._aligned_at is not None
        return self._aligned_at.keyframe

    def placed(self, alignment: Alignment) -> tuple[np.ndarray, int]:
        """The pose [4, 4] of the newest alignment, moved with its reference, and its pose version."""
        assert self._aligned_at is not None
        return self._aligned_at.followed(orthonormal(alignment.T_world_cam), self._store)

    def placed_beside(self, k: int, alignment: Alignment) -> tuple[np.ndarray, np.ndarray, int]:
        """As `placed`, with T_keyframe_cam [4, 4] from the pose of keyframe k at the same pose version."""
        while True:
            T, version = self.placed(alignment)
            T_world_key, its_version = self._store.pose_at(k)
            if its_version == version:
                return T, inverse(T_world_key) @ T, version

    def doubt(self, alignment: Alignment) -> PoseDoubt:
        """Covariances of the newest alignment."""
        assert alignment.evidence is not None and self._aligned_at is not None
        lever_m = alignment.T_world_cam[:3, 3] - self._aligned_at.T_world_ref[:3, 3]
        of_reference = self._store.covariance(self._aligned_at.keyframe)
        return PoseDoubt(alignment.evidence.covariance(), of_reference, lever_m)

    def observe(self, alignment: Alignment) -> Reference:
        """Update exposure and coverage of the reference by an accepted alignment; returns the reference."""
        assert self.reference is not None
        coverage = max(self.reference.coverage, alignment.surface_coverage)
        self.reference = replace(self.reference, exposure=alignment.exposure, coverage=coverage)
        return self.reference

    def take_untracked(self) -> bool:
        """Whether the camera was not tracked from the newest keyframe to the one that is appended now;
        clears `is_at_place`."""
        assert self.reference is not None
        is_untracked = self.reference.is_at_place
        self.reference = replace(self.reference, is_at_place=False)
        return is_untracked

    def needs_another(self, alignment: Alignment, T_world_cam: np.ndarray, frame: Frame) -> bool:
        """Whether another keyframe would show more of a frame that was aligned at T_world_cam [4, 4]."""
        assert self.reference is not None
        return self.reference.needs_replacing(
            alignment, T_world_cam, frame, self._store, self._config
        )

    def refer_to(self, keyframe: int, *, is_at_place: bool = False) -> None:
        """Align to a keyframe of the store; `is_at_place`: as in `Reference`."""
        stored = stored_reference(self._store, keyframe, self._config)
        self.reference = Reference(stored, is_at_place=is_at_place)

    def refer_to_new(self, k: int, frame: Frame, levels: tuple[PyramidLevel, ...]) -> None:
        """Align to a frame that has just become keyframe k."""
        self.reference = Reference(reference_keyframe(k, frame, levels, self._config))

    def refer_to_covering(self, frame: Frame, T_world_cam: np.ndarray) -> None:
        """Align to the keyframe that shows most of a frame at about T_world_cam [4, 4]."""
        k = covering_keyframe(self._store, frame, T_world_cam, self.keyframe)
        if k != self.keyframe:
            is_at_place = self.reference is not None and self.reference.is_at_place
            with contextlib.suppress(RetiredKeyframeError):  # meanwhile: the reference stays
                self.refer_to(k, is_at_place=is_at_place)

    def refer_next_to_new(self, k: int, frame: Frame, seen: Observation) -> None:
        """Align the next frame to keyframe k; `frame`: that of `seen`, without moving objects."""
        levels = seen.levels if frame is seen.frame else grey_pyramid(frame)
        views = views_near(self._store, k, frame, self._config)
        self._next = lambda: Reference(reference_keyframe(k, frame, levels, self._config, views))

    def refer_next_to_covering(self, frame: Frame, T_world_cam: np.ndarray) -> None:
        """Align the next frame to the keyframe that shows clearly more of this one, if one does."""
        k = covering_keyframe(self._store, frame, T_world_cam, self.keyframe)
        if k == self.keyframe:
            return
        with contextlib.suppress(RetiredKeyframeError):  # meanwhile: the reference stays
            # views at the poses of this frame: bundle adjustment may correct them before the next one
            views = views_near(self._store, k, self._store.frame(k), self._config)
            self._next = lambda: Reference(self._stored(k, views), is_at_place=True)

    def _stored(self, k: int, views: OtherViews | None) -> ReferenceKeyframe:
        frame = self._store.frame(k)
        return reference_keyframe(k, frame, grey_pyramid(frame), self._config, views)

    def prepare_next(self) -> None:
        """Prepare the reference keyframe of the next frame; the last pose did not need it."""
        if self._next is not None:
            with contextlib.suppress(RetiredKeyframeError):  # meanwhile: the reference stays
                self.reference = self._next()
            self._next = None

    def take_over(self, other: "ReferenceAligner", joined: JoinedFragment) -> None:
        """Continue with the reference of a fragment that has joined the store."""
        other.prepare_next()
        assert other.reference is not None
        keyframe = other.reference.keyframe
        moved = int(joined.keyframes[keyframe.id])
        if (joined.T_keyframe_own[keyframe.id] == np.eye(4)).all():
            keyframe = replace(keyframe, id=moved)
        else:
            keyframe = stored_reference(self._store, moved, self._config)
        self.reference = replace(other.reference, keyframe=keyframe)
        self._next = None
