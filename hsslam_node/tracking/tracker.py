"""The tracker: one frame in, one pose with its quality out."""

from dataclasses import replace

import numpy as np

from hsslam_node.config import SlamConfig
from hsslam_node.frame import Frame
from hsslam_node.geometry.pose_covariance import UNTRACKED, turned
from hsslam_node.geometry.se3 import inverse
from hsslam_node.map.pose_log import Status
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.bound import first_pose, may_begin_map
from hsslam_node.tracking.aligned.acceptance import quality
from hsslam_node.tracking.aligned.new_keyframes import NewKeyframe, NewKeyframes
from hsslam_node.tracking.aligned.observation import Observation
from hsslam_node.tracking.aligned.reference_aligner import ReferenceAligner
from hsslam_node.tracking.alignment.align import Alignment
from hsslam_node.tracking.dead_reckoning import DeadReckoning, Reckoning
from hsslam_node.tracking.map_view import MapView
from hsslam_node.tracking.motion import CameraMotion
from hsslam_node.tracking.places.place_near import Whereabouts
from hsslam_node.tracking.places.relocalisation import Relocalisation
from hsslam_node.tracking.pose_search import FOLLOWED_FRAMES, PoseSearch
from hsslam_node.tracking.tracked_frame import JoinedFragment, TrackResult
from hsslam_node.tracking.tracking_work import TrackingWork

_DEAD_RECKONED_FRAMES = 20  # with depth; then the next one becomes a keyframe


class Tracker:
    """Tracks frames one by one, appends keyframes to the store and follows corrections of their poses.

    The first frame defines the world. A frame that cannot be aligned is lost; the search for the next
    one starts at the last good pose. If frames carry odometry, it predicts poses, and a frame that cannot
    be aligned is dead-reckoned while the pose is sure enough. After 20 dead-reckoned frames with depth the
    next one becomes a keyframe. If frames carry IMU readings, these predict rotations and measure gravity.
    """

    def __init__(self, config: SlamConfig, store: KeyframeStore, seed: int) -> None:
        self._slam = config
        self._config = config.tracker
        self._store = store
        self._seed = seed
        self._motion = CameraMotion(config.tracker, store)
        self._aligner = ReferenceAligner(config.tracker, store)
        self._relocalisation = Relocalisation(config.tracker, store, seed)
        self._reckoned = DeadReckoning()
        self._search = PoseSearch(
            config.tracker, self._aligner, self._motion, self._reckoned, self._relocalisation
        )
        self._keyframes = NewKeyframes(config, store)
        self._work = TrackingWork()
        self._of_frame = config.tracker  # with the points of a frame

    def resume(self, *, anywhere: bool = False) -> None:
        """Continue in an existing map, as a camera that is lost at the newest keyframe.

        `anywhere`: the camera may be at any place of the map, so index all keyframes first (15 ms for
        each with a new view).
        """
        self._store.forget_incomplete()
        newest = self._store.count - 1
        self._motion.resume(newest, lost_frames=FOLLOWED_FRAMES if anywhere else 1)
        self._aligner.refer_to(newest)
        if anywhere:
            self._relocalisation.observe_all()

    @property
    def places(self) -> Relocalisation:
        """The places that the camera has seen."""
        return self._relocalisation

    @property
    def is_bridged(self) -> bool:
        """Whether odometry alone has bridged a part of the way since the newest keyframe."""
        return self._reckoned.is_open

    def take_over(self, other: "Tracker", joined: JoinedFragment) -> None:
        """Continue from the tracker of a fragment that has joined this tracker's store."""
        self._reckoned.take_over(other._reckoned, joined.place, other._motion.T_world_last)
        self._motion.take_over(other._motion, joined)
        self._aligner.take_over(other._aligner, joined)
        self._keyframes.take_over(other._keyframes, joined)

    def track(
        self, frame: Frame, view: MapView | None, *, localise_only: bool = False
    ) -> TrackResult:
        """Return the pose of the frame, and append a keyframe to the store if one is due.

        `localise_only`: append none; the existing keyframes serve as references.

        Raises:
            TornMapError: the map was overwritten meanwhile. No state has changed: track the frame again.
        """
        seen = self._observed(frame, view, localise_only=localise_only)
        if not self._motion.has_begun:
            return self._start(seen)
        self._motion.take(frame)
        prediction = self._motion.predicted(frame.stamp_ns)
        expected = self._reckoned.expected(self._motion.T_world_last, frame.odometry)
        reckoning = None if self._reckoned.disagrees else expected
        found = self._search.from_motion(seen, prediction, reckoning)
        if found is not None:
            return self._accept(seen, found, expected)
        if reckoning is None:
            return self._lose(seen, prediction)
        if not reckoning.is_within_reach(self._config):
            return self._lose(seen, reckoning.T_world_cam)
        if self._may_append_unaligned(seen):
            return self._append_unaligned(seen, reckoning)
        return self._dead_reckon(seen, reckoning)

    def find_near(
        self, frame: Frame, view: MapView | None, near: Whereabouts, *, localise_only: bool = False
    ) -> TrackResult | None:
        """Return the pose of the frame near a place that a person names, or None if it does not show it.

        After None no state has changed: call `track`. The answer is also None for a camera that is neither
        lost nor dead-reckoned, unless `localise_only` is set.

        Raises:
            TornMapError: as by `track`.
        """
        is_lost = self._motion.lost_frames > 0 or self._reckoned.is_on
        if not self._motion.has_begun or not (localise_only or is_lost):
            return None
        self._store.expect_like(frame)
        place = self._relocalisation.place_near(frame, near)
        if place is None:
            return None
        seen = self._observed(frame, view, localise_only=localise_only)
        found = self._search.at_place(seen, place)
        if found is None:
            return None
        self._motion.note_carried()
        return self._accept(seen, found, None)

    def finish(self) -> None:
        """Do nothing: this tracker has no fragments."""

    def limit_work(self, work: TrackingWork) -> None:
        """Do only this work for the next frames; a fast change of the view makes a keyframe at any spacing.

        A camera that only localises always asks the map, as the map alone knows where it ends.
        """
        if work == self._work:
            return
        self._work = work
        self._keyframes.spacing = work.keyframes_every
        surface_points = self._slam.tracker.surface_points if work.uses_surface_points else 0
        self._of_frame = replace(self._slam.tracker, surface_points=surface_points)

    def prepare_next(self) -> None:
        """Prepare the reference keyframe of the next frame; the pose of the last frame did not need it."""
        self._aligner.prepare_next()

    def _observed(self, frame: Frame, view: MapView | None, *, localise_only: bool) -> Observation:
        self.prepare_next()
        self._store.expect_like(frame)
        is_beside = self._reckoned.is_open  # the map does not cover this place yet
        is_left_out = not self._work.uses_map and not self._motion.lost_frames
        if (is_beside or is_left_out) and not localise_only:
            view = None
        return Observation.of(
            frame, view, self._of_frame, self._seed,
            localise_only=localise_only, averaging=self._aligner.averaging,
        )  # fmt: skip

    def _start(self, seen: Observation) -> TrackResult:
        frame = seen.frame
        may_begin = may_begin_map(frame, self._slam.mapper.max_depth_m)
        if not (seen.has_depth and may_begin) or seen.localise_only:  # nothing to start a map on
            return TrackResult.without_map(frame.index)
        T_world_cam = first_pose(self._slam.bound)
        k = self._store.append(frame, T_world_cam)
        self._go_on_from(k, seen)
        self._reckoned.restart(frame.odometry, np.zeros((6, 6)), None)
        return TrackResult.first(frame.index, k, T_world_cam)

    def _accept(
        self, seen: Observation, alignment: Alignment, reckoning: Reckoning | None
    ) -> TrackResult:
        """Take an aligned frame: append a keyframe if one is due, and choose the next reference."""
        frame, motion, aligner = seen.frame, self._motion, self._aligner
        T, version = aligner.placed(alignment)
        doubt = aligner.doubt(alignment)
        gap = self._reckoned.gap_at(motion.T_world_last, T)
        reference = aligner.observe(alignment)
        self._keyframes.frames_since += 1
        new = None
        has_gap = bool(gap.any()) or reference.is_at_place
        if self._keyframes.is_due(seen, alignment, T, reference.coverage, has_gap=has_gap):
            new = self._keyframes.append(frame, alignment, aligner, doubt, gap)
            T, version = new.T_world_cam, new.pose_version
            k, T_keyframe_cam = new.id, np.eye(4)
        else:
            is_elsewhere = seen.localise_only or reference.is_at_place
            k = aligner.keyframe if is_elsewhere else self._store.count - 1
            T, T_keyframe_cam, version = aligner.placed_beside(k, alignment)
        self._choose_next_reference(seen, alignment, T, new)
        is_lost = motion.lost_frames > 0
        T_expected = self._reckoned.expected_back(reckoning, self._config, is_lost=is_lost)
        is_followed = not (self._search.is_at_place or self._reckoned.is_on)
        T_last_cam = None if is_lost else inverse(motion.T_world_last) @ T
        if reckoning is not None and is_followed and T_last_cam is not None:
            seconds = 1e-9 * (frame.stamp_ns - motion.last.frame.stamp_ns)
            self._reckoned.compare(reckoning, T_last_cam, seconds)
        motion.aligned(frame, T, k, T_keyframe_cam)
        covariance = doubt.in_world()
        is_joined = new is not None or seen.localise_only
        self._reckoned.restart(
            frame.odometry,
            covariance,
            None if is_joined else gap,
            T_last_cam if is_followed else None,
        )
        self._relocalisation.observe()
        return TrackResult(
            frame_index=frame.index, status="tracked", T_world_cam=T, keyframe=k,
            T_keyframe_cam=T_keyframe_cam, quality=quality(alignment),
            residual_m=alignment.sdf_rms_m, map_version=seen.map_version,
            is_keyframe=new is not None, outside=alignment.outside, pose_version=version,
            covariance=covariance, imu_disagrees=motion.imu_disagrees, T_expected=T_expected,
            is_carried=T_expected is None and not is_followed, odometry_disagrees=self._reckoned.disagrees,
            implausible_gravity=motion.implausible_gravity,
        )  # fmt: skip

    def _choose_next_reference(
        self, seen: Observation, alignment: Alignment, T: np.ndarray, new: NewKeyframe | None
    ) -> None:
        """Refer to the new keyframe, or if localising to another one, if it shows more of the frame at T."""
        if new is not None:
            if self._aligner.needs_another(alignment, T, seen.frame):
                self._aligner.refer_next_to_new(new.id, new.frame, seen)
        elif seen.localise_only:
            needs_another = self._aligner.needs_another(alignment, T, seen.frame)
            if needs_another or self._keyframes.is_late:
                self._keyframes.frames_since = 0
                self._aligner.refer_next_to_covering(seen.frame, T)

    def _dead_reckon(self, seen: Observation, reckoning: Reckoning) -> TrackResult:
        """Place a frame by odometry alone; it becomes no keyframe."""
        covariance = self._reckoned.add(reckoning, sees=seen.has_depth)
        result = self._unaligned(seen, reckoning.T_world_cam, "dead_reckoned")
        return replace(result, covariance=covariance)

    def _may_append_unaligned(self, seen: Observation) -> bool:
        is_long = self._reckoned.unaligned_frames >= _DEAD_RECKONED_FRAMES
        return (
            is_long
            and seen.has_depth
            and not seen.localise_only
            and self._store.has_room(has_gap=True)
        )

    def _append_unaligned(self, seen: Observation, reckoning: Reckoning) -> TrackResult:
        """Append a keyframe at the dead-reckoned pose and track from it. After a loop closure, bundle
        adjustment may move it as far as the covariance of the odometry allows."""
        frame = seen.frame
        covariance = self._reckoned.add(reckoning, sees=True)
        with self._store.appending():
            last = self._motion.last
            T_world_key, version = self._store.pose_at(last.keyframe)
            T_last = T_world_key @ last.T_keyframe_cam
            T = Reckoning.after(T_last, reckoning.motion).T_world_cam
            gap = self._reckoned.gap_at(T_last, T)
            if self._aligner.take_untracked():
                gap = gap + UNTRACKED
            gap = turned(gap, T[:3, :3].T)
            fragment = self._keyframes.fragment
            k = self._store.append(
                frame, T, version, covariance, gap, fragment, reference=last.keyframe
            )
        self._go_on_from(k, seen)
        self._reckoned.restart(frame.odometry, covariance, None)
        self._relocalisation.observe()
        return TrackResult(
            frame_index=frame.index, status="tracked", T_world_cam=T, keyframe=k,
            T_keyframe_cam=np.eye(4), map_version=seen.map_version, is_keyframe=True,
            pose_version=version, covariance=covariance, T_expected=T,
        )  # fmt: skip

    def _go_on_from(self, k: int, seen: Observation) -> None:
        """Continue from a frame that is now keyframe k and was not aligned to another."""
        self._keyframes.begin(k, seen.frame)
        self._aligner.refer_to_new(k, seen.frame, seen.levels)
        self._motion.begin(seen.frame, k)

    def _lose(self, seen: Observation, T: np.ndarray) -> TrackResult:
        return self._unaligned(seen, T, "lost")

    def _unaligned(self, seen: Observation, T: np.ndarray, status: Status) -> TrackResult:
        self._motion.unaligned(is_lost=status == "lost")
        k = self._motion.last.keyframe
        return TrackResult(
            frame_index=seen.frame.index, status=status, T_world_cam=T, keyframe=k,
            T_keyframe_cam=inverse(self._store.pose(k)) @ T, map_version=seen.map_version,
        )  # fmt: skip
