"""The tracker: one frame in, one pose with its quality out."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from hsslam_node.config import SlamConfig
from hsslam_node.frame import Frame
from hsslam_node.geometry.pose_covariance import in_world, of_new_keyframe, turned
from hsslam_node.geometry.se3 import inverse
from hsslam_node.map.pose_log import Status
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.bound import first_pose
from hsslam_node.place_recognition.still_camera import StillCamera
from hsslam_node.tracking.aligned.acceptance import (
    is_acceptable,
    is_confirmed,
    is_left_behind,
    quality,
)
from hsslam_node.tracking.aligned.reference import AlignedAt, Reference
from hsslam_node.tracking.alignment import Alignment, align
from hsslam_node.tracking.dead_reckoning import DeadReckoning, Reckoning
from hsslam_node.tracking.dynamic_mask import DynamicMask
from hsslam_node.tracking.inertial.prior import InertialPrior
from hsslam_node.tracking.keyframes.covering_keyframe import covering_keyframe
from hsslam_node.tracking.keyframes.other_views import views_near
from hsslam_node.tracking.keyframes.reference_keyframe import (
    PyramidLevel,
    ReferenceKeyframe,
    grey_pyramid,
    reference_keyframe,
    stored_reference,
)
from hsslam_node.tracking.map_view import MapView, TornMapError
from hsslam_node.tracking.odometry import rgbd_odometry
from hsslam_node.tracking.places.place_near import Whereabouts
from hsslam_node.tracking.places.relocalisation import Relocalisation
from hsslam_node.tracking.tracked_frame import (
    LONGEST_EXTRAPOLATION,
    JoinedFragment,
    TrackedFrame,
    TrackResult,
    frame_points,
    is_foreseen,
    orthonormal,
    predicted_pose,
)

_FEWEST_POINTS = 100
_FEWEST_BETWEEN = 2  # frames from keyframe to keyframe, also where the view changes fast
_FOLLOWED_FRAMES = 3  # that are compared with the last good one after it was lost
_UNALIGNED_FRAMES = 10  # by odometry alone, though they see something: then other places are tried
_ANEW_FRAMES = 20  # of these: then the next is a keyframe, as no keyframe shows what they see


class Tracker:
    """Tracks frames one by one and appends keyframes to the store, whose poses it follows.

    The first frame defines the world. A frame that cannot be aligned is reported as lost; the next
    ones are aligned to the last pose that was good. If frames carry odometry, it predicts poses, and a frame
    that cannot be aligned gets its pose by odometry alone, up to a distance; if no keyframe shows what it
    sees, it becomes one. If frames carry readings of an IMU, these predict rotations, and the store gets to
    know gravity.
    """

    def __init__(self, config: SlamConfig, store: KeyframeStore, seed: int) -> None:
        self._slam = config
        self._config = config.tracker
        self._store = store
        self._seed = seed
        self._last: TrackedFrame | None = None
        self._before_last: TrackedFrame | None = None
        self._reference: Reference | None = None
        self._relocalisation = Relocalisation(config.tracker, store, seed)
        self._dynamic = DynamicMask(store)
        self._still = StillCamera(store, config.keyframes.still)
        self._aligned_at: AlignedAt | None = None  # of the newest alignment
        self._since_keyframe = 0
        self._lost_frames = 0
        self._next_reference: Callable[[], ReferenceKeyframe] | None = None
        self._localise_only = False
        self._reckoned = DeadReckoning()
        self._inertial = InertialPrior(store, config.tracker.inertial_rotation)
        self._fragment = 0  # of the keyframes that come

    def resume(self, *, anywhere: bool = False) -> None:
        """In a map that is there: go on from the newest keyframe of the store, as a lost camera.

        `anywhere`: it may be at any place of the map, so all keyframes are taken in first (15 ms for
        each that shows something new).
        """
        self._store.forget_incomplete()
        newest = self._store.count - 1
        self._last = TrackedFrame(self._store.frame(newest), newest, np.eye(4))
        self._before_last = None
        self._lost_frames = 1
        self._reference = self._stored(newest)
        if anywhere:
            self._lost_frames = _FOLLOWED_FRAMES
            self._relocalisation.observe_all()

    @property
    def places(self) -> Relocalisation:
        """The places that the camera has seen."""
        return self._relocalisation

    @property
    def held_keyframes(self) -> set[int]:
        """The keyframes that the next frame is tracked from."""
        self.prepare_next()
        frames = [f.keyframe for f in (self._last, self._before_last) if f is not None]
        return {*frames, *([self._reference.keyframe.id] if self._reference else [])}

    def take_over(self, other: "Tracker", joined: JoinedFragment) -> None:
        """Go on where the tracker of a fragment is that has joined this one's store."""
        other.prepare_next()
        assert other._last is not None and other._reference is not None
        self._last = joined.placed(other._last)
        self._before_last = other._before_last and joined.placed(other._before_last)
        keyframe = other._reference.keyframe
        moved = int(joined.keyframes[keyframe.id])
        if (joined.T_keyframe_own[keyframe.id] == np.eye(4)).all():
            keyframe = replace(keyframe, id=moved)
        else:
            keyframe = stored_reference(self._store, moved, self._config)
        self._reference = replace(other._reference, keyframe=keyframe)
        self._since_keyframe = other._since_keyframe
        self._lost_frames, self._next_reference = 0, None
        self._reckoned = DeadReckoning()
        self._inertial.restart(None)
        self._fragment = joined.fragment

    def track(
        self, frame: Frame, view: MapView | None, *, localise_only: bool = False
    ) -> TrackResult:
        """Pose of the frame; a keyframe is appended to the store where one is due.

        `localise_only`: none is, and the keyframes that there are serve as references.

        Raises:
            TornMapError: the map was overwritten meanwhile; nothing has changed, track again.
        """
        self.prepare_next()
        self._localise_only = localise_only
        if self._reckoned.is_open and not localise_only:  # the map has not learnt what is seen now
            view = None
        self._store.expect_like(frame)
        levels = grey_pyramid(frame)
        points = frame_points(frame, self._config, self._seed)
        if self._last is None:
            return self._start(frame, levels, len(points))
        self._inertial.take(frame.imu)
        prediction = self._predicted(frame)
        expected = prediction if self._is_foreseen(frame.stamp_ns) else None
        reckoning = self._reckoned.expected(self._last.pose(self._store), frame.odometry)
        before = self._reference
        try:
            if reckoning is not None:
                best = self._align_to_odometry(frame, points, levels, reckoning, view)
                if best is not None:
                    return self._accept(frame, levels, best, view, reckoning)
                self._reference = before
                if len(points) < _FEWEST_POINTS and reckoning.is_within_reach(self._config):
                    return self._reckon(frame, reckoning, view, sees=False)
            for guess in self._guesses(frame, prediction, after_gap=expected is None):
                best = self._try(points, levels, guess, view)
                good = self._is_good(best, guess, frame.stamp_ns)
                if good and self._reference is before:  # else a place, which has been checked
                    good = self._is_confirmed(best, expected, frame)
                if good:
                    return self._accept(frame, levels, best, view, reckoning)
        except TornMapError:
            self._reference = before
            raise
        self._reference = before  # not one that was tried in vain
        if reckoning is None:
            return self._lose(frame, prediction, view)
        if not reckoning.is_within_reach(self._config):
            return self._lose(frame, reckoning.T_world_cam, view)
        if self._reckoned.unaligned_frames >= _ANEW_FRAMES and self._may_begin_anew(points):
            return self._begin_anew(frame, levels, reckoning, view)
        return self._reckon(frame, reckoning, view, sees=True)

    def finish(self) -> None:
        """Nothing is left to do if no frame comes any more: it has no fragments."""

    def find_near(
        self, frame: Frame, view: MapView | None, near: Whereabouts, *, localise_only: bool = False
    ) -> TrackResult | None:
        """Pose of the frame near a place that a person names; None if it does not show that place, and
        nothing has changed: track the frame.

        A camera that is tracked while the map grows is not looked for.

        Raises:
            TornMapError: as by `track`.
        """
        self.prepare_next()
        if self._last is None or not (localise_only or self._lost_frames):
            return None
        self._store.expect_like(frame)
        place = self._relocalisation.place_near(frame, near)
        if place is None:
            return None
        levels, points = grey_pyramid(frame), frame_points(frame, self._config, self._seed)
        view = None if self._reckoned.is_open and not localise_only else view
        before, self._reference = self._reference, Reference(place.reference)
        self._localise_only = localise_only
        is_found = False
        try:
            best = self._try(points, levels, place.T_world_cam, view)
            is_found = is_acceptable(
                best, place.T_world_cam, after_gap=True, localise_only=localise_only,
                config=self._config,
            )  # fmt: skip
        finally:
            if not is_found:
                self._reference = before
        if not is_found:
            return None
        self._lost_frames = max(self._lost_frames, 1)  # the way there is no motion of the camera
        return self._accept(frame, levels, best, view, None)

    def prepare_next(self) -> None:
        """Prepare what the next frame is aligned to, which the pose of the last one did not need."""
        if self._next_reference is not None:
            self._reference = Reference(self._next_reference())
            self._next_reference = None

    def _start(self, frame: Frame, levels: tuple[PyramidLevel, ...], points: int) -> TrackResult:
        if points < _FEWEST_POINTS or self._localise_only:  # nothing to start a map on
            return TrackResult.without_map(frame.index)
        T_world_cam = first_pose(self._slam.bound)
        k = self._store.append(frame, T_world_cam)
        self._refer_to_new(k, frame, levels)
        self._reckoned.restart(frame.odometry, np.zeros((6, 6)), None)
        self._inertial.restart(frame.imu)
        return TrackResult.first(frame.index, k, T_world_cam)

    def _predicted(self, frame: Frame, longest: float = LONGEST_EXTRAPOLATION) -> np.ndarray:
        """T_world_cam [4, 4] by constant velocity; the rotation by the IMU if there is one."""
        assert self._last is not None
        T = predicted_pose(self._last, self._before_last, self._store, frame.stamp_ns, longest)
        return self._inertial.turned(T, self._last.pose(self._store))

    def _guesses(
        self, frame: Frame, prediction: np.ndarray, *, after_gap: bool
    ) -> Iterator[np.ndarray]:
        """After a gap, as far on as it is long; as predicted; at rest; by OpenCV's RGB-D odometry from the
        last good frame; after a gap, or when lost, at a place seen before."""
        assert self._last is not None
        T_last = self._last.pose(self._store)
        if after_gap and self._before_last is not None:
            yield self._predicted(frame, longest=np.inf)
        yield prediction
        if self._before_last is not None:
            yield T_last
        reckoned = self._reckoned
        if self._lost_frames + reckoned.unaligned_frames < _FOLLOWED_FRAMES:
            T_last_cam = rgbd_odometry(self._last.frame, frame)
            if T_last_cam is not None:
                yield T_last @ T_last_cam
        is_reckoned = reckoned.is_on and self._lost_frames == 0
        if not after_gap or (is_reckoned and reckoned.unaligned_frames < _UNALIGNED_FRAMES):
            return
        for place in self._relocalisation.places(frame):
            self._reference = Reference(place.reference)
            yield place.T_world_cam

    def _try(
        self, points: np.ndarray, levels: tuple[PyramidLevel, ...], T: np.ndarray,
        view: MapView | None, doubt: np.ndarray | None = None,
    ) -> Alignment | None:  # fmt: skip
        if len(points) < _FEWEST_POINTS or self._reference is None:
            return None
        reference = self._reference
        self._aligned_at = AlignedAt.now(reference.keyframe.id, self._store)
        found = align(
            points, levels, T, view, reference.keyframe, self._aligned_at.T_world_ref, self._config,
            reference.exposure, doubt,
        )  # fmt: skip
        if view is not None:
            view.expect_intact()
        return found

    def _is_good(self, alignment: Alignment | None, prediction: np.ndarray, stamp_ns: int) -> bool:
        assert self._last is not None
        gap_s = 1e-9 * (stamp_ns - self._last.frame.stamp_ns)
        after_gap = self._lost_frames > 0 or gap_s > self._config.longest_gap_s
        return is_acceptable(
            alignment, prediction, after_gap=after_gap, localise_only=self._localise_only,
            config=self._config,
        )  # fmt: skip

    def _is_foreseen(self, stamp_ns: int) -> bool:
        assert self._last is not None
        return self._lost_frames == 0 and is_foreseen(self._last, self._before_last, stamp_ns)

    def _is_confirmed(
        self, best: Alignment | None, expected: np.ndarray | None, frame: Frame
    ) -> bool:
        assert best is not None and self._last is not None
        T_world_last = self._last.pose(self._store)
        return is_confirmed(best.T_world_cam, expected, frame, self._last, T_world_last)

    def _accept(
        self, frame: Frame, levels: tuple[PyramidLevel, ...], alignment: Alignment | None,
        view: MapView | None, reckoning: Reckoning | None,
    ) -> TrackResult:  # fmt: skip
        at, before = self._aligned_at, self._reference
        assert (
            alignment is not None
            and self._last is not None
            and at is not None
            and before is not None
        )
        T, version = at.followed(orthonormal(alignment.T_world_cam), self._store)
        self._since_keyframe += 1
        coverage = max(before.coverage, alignment.surface_coverage)
        reference = Reference(before.keyframe, alignment.exposure, coverage)
        own, of_reference, lever_m = self._doubt(alignment)
        gap = self._reckoned.gap_at(self._last.pose(self._store), T)
        is_keyframe = self._is_keyframe(alignment, T, levels, coverage)
        if is_keyframe:
            self._since_keyframe = 0
            with self._store.appending():
                T, version = at.followed(
                    orthonormal(alignment.T_world_cam), self._store
                )  # as of now
                still = self._dynamic.left_out(frame, T)
                of_gap = turned(gap + own, T[:3, :3].T) if gap.any() else gap
                k = self._store.append(
                    still,
                    T,
                    version,
                    of_new_keyframe(own, of_reference, lever_m),
                    of_gap,
                    self._fragment,
                )
            self._dynamic.observe(k, still)
            T_keyframe_cam = np.eye(4)
        else:
            still = frame
            k = before.keyframe.id if self._localise_only else self._store.count - 1
            T_keyframe_cam = inverse(self._store.pose(k)) @ T
        self._reference = reference
        needs_another = partial(
            reference.needs_replacing, alignment, T, frame, self._store, self._config
        )
        if is_keyframe and needs_another():
            of_still = levels if still is frame else grey_pyramid(still)
            views = views_near(self._store, k, still, self._config.reference_views)
            self._next_reference = partial(
                reference_keyframe, k, still, of_still, self._config.photometric_pixels, views
            )
        elif self._localise_only:
            self._refer_to_saved(frame, T, needs_another())
        if self._lost_frames == 0:
            T_last_cam = inverse(self._last.pose(self._store)) @ T
            self._inertial.aligned(frame.imu, T_last_cam, k, T_keyframe_cam)
        else:
            self._inertial.restart(frame.imu)
        # a camera that was lost may have been carried: that is no motion to expect more of
        self._before_last = self._last if self._lost_frames == 0 else None
        self._last = TrackedFrame(frame, k, T_keyframe_cam)
        covariance = in_world(own, of_reference, lever_m)
        is_back = self._reckoned.is_on and self._lost_frames == 0
        T_expected = reckoning.T_world_cam if reckoning is not None and is_back else None
        self._lost_frames = 0
        is_joined = is_keyframe or self._localise_only
        self._reckoned.restart(frame.odometry, covariance, None if is_joined else gap)
        self._relocalisation.observe()
        return TrackResult(
            frame_index=frame.index, status="tracked", T_world_cam=T, keyframe=k,
            T_keyframe_cam=T_keyframe_cam, quality=quality(alignment),
            residual_m=alignment.sdf_rms_m, map_version=view.version if view else 0,
            is_keyframe=is_keyframe, outside=alignment.outside, pose_version=version,
            covariance=covariance, T_expected=T_expected, imu_disagrees=self._inertial.disagrees,
        )  # fmt: skip

    def _doubt(self, alignment: Alignment) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Covariances of the pose against the reference and of the reference [6, 6], and the way [3] m
        from this to that."""
        assert alignment.evidence is not None and self._aligned_at is not None
        lever_m = alignment.T_world_cam[:3, 3] - self._aligned_at.T_world_ref[:3, 3]
        of_reference = self._store.covariance(self._aligned_at.keyframe)
        return alignment.evidence.covariance(), of_reference, lever_m

    def _is_keyframe(
        self, alignment: Alignment, T: np.ndarray, levels: tuple[PyramidLevel, ...], coverage: float
    ) -> bool:
        """Whether the frame is due as a keyframe, there is room for it, and the camera does not stand
        still."""
        if self._localise_only:
            return False
        is_left = self._since_keyframe >= _FEWEST_BETWEEN and is_left_behind(
            alignment, coverage, self._config
        )
        is_due = is_left or self._since_keyframe >= self._slam.keyframes.every_frames
        if not is_due or not self._store.has_room():
            return False
        return not self._still.has_enough(T, levels[0].grey) or is_left

    def _align_to_odometry(
        self, frame: Frame, points: np.ndarray, levels: tuple[PyramidLevel, ...],
        reckoning: Reckoning, view: MapView | None,
    ) -> Alignment | None:  # fmt: skip
        """The frame aligned near the pose that odometry predicts, after a gap to the keyframe that shows most
        of it; None if it does not fit."""
        assert self._reference is not None
        T = reckoning.T_world_cam
        if self._reckoned.is_on and len(points) >= _FEWEST_POINTS:
            k = covering_keyframe(self._store, frame, T, self._reference.keyframe.id)
            if k != self._reference.keyframe.id:
                self._reference = self._stored(k)
        best = self._try(points, levels, T, view, reckoning.doubt)
        if not reckoning.is_sure:
            good = self._is_good(best, T, frame.stamp_ns) and self._is_confirmed(best, None, frame)
            return best if good else None
        fits = is_acceptable(
            best, T, after_gap=False, localise_only=self._localise_only, config=self._config
        )
        if fits and self._is_confirmed(best, T, frame):
            return best
        return best if reckoning.agrees(best, self._config) and not self._localise_only else None

    def _reckon(
        self, frame: Frame, reckoning: Reckoning, view: MapView | None, *, sees: bool
    ) -> TrackResult:
        """A frame whose pose is by odometry alone: it becomes no keyframe, and nothing is aligned to it."""
        covariance = self._reckoned.add(reckoning, sees=sees)
        result = self._unaligned(frame, reckoning.T_world_cam, view, "dead_reckoned")
        return replace(result, covariance=covariance)

    def _may_begin_anew(self, points: np.ndarray) -> bool:
        return len(points) >= _FEWEST_POINTS and not self._localise_only and self._store.has_room()

    def _begin_anew(
        self, frame: Frame, levels: tuple[PyramidLevel, ...], reckoning: Reckoning,
        view: MapView | None,
    ) -> TrackResult:  # fmt: skip
        """A keyframe where the camera is by odometry alone, from which it is tracked on; bundle adjustment
        moves it once a loop tells better, by how unsure that odometry is."""
        assert self._last is not None
        covariance = self._reckoned.add(reckoning, sees=True)
        with self._store.appending():
            version = self._store.pose_version
            T_last = self._last.pose(self._store)  # as of now
            T = Reckoning.after(T_last, reckoning.motion).T_world_cam
            gap = turned(self._reckoned.gap_at(T_last, T), T[:3, :3].T)
            k = self._store.append(frame, T, version, covariance, gap, self._fragment)
        self._refer_to_new(k, frame, levels)
        self._before_last, self._since_keyframe = None, 0
        self._reckoned.restart(frame.odometry, covariance, None)
        self._inertial.restart(frame.imu)
        self._relocalisation.observe()
        return TrackResult(
            frame_index=frame.index, status="tracked", T_world_cam=T, keyframe=k,
            T_keyframe_cam=np.eye(4), map_version=view.version if view else 0, is_keyframe=True,
            pose_version=version, covariance=covariance, T_expected=T,
        )  # fmt: skip

    def _lose(self, frame: Frame, T: np.ndarray, view: MapView | None) -> TrackResult:
        self._lost_frames += 1
        return self._unaligned(frame, T, view, "lost")

    def _unaligned(
        self, frame: Frame, T: np.ndarray, view: MapView | None, status: Status
    ) -> TrackResult:
        assert self._last is not None
        self._before_last = None
        k = self._last.keyframe
        return TrackResult(
            frame_index=frame.index, status=status, T_world_cam=T, keyframe=k,
            T_keyframe_cam=inverse(self._store.pose(k)) @ T, map_version=view.version if view else 0,
        )  # fmt: skip

    def _stored(self, k: int) -> Reference:
        return Reference(stored_reference(self._store, k, self._config))

    def _refer_to_new(self, k: int, frame: Frame, levels: tuple[PyramidLevel, ...]) -> None:
        """Go on from a frame that is keyframe k now and was not aligned to another."""
        self._dynamic.observe(k, frame)
        pixels = self._config.photometric_pixels
        self._reference = Reference(reference_keyframe(k, frame, levels, pixels))
        self._last = TrackedFrame(frame, k, np.eye(4))

    def _refer_to_saved(self, frame: Frame, T: np.ndarray, needs_another: bool) -> None:
        """Take a keyframe of the map as the reference that shows clearly more of the frame."""
        assert self._reference is not None
        if not needs_another and self._since_keyframe < self._slam.keyframes.every_frames:
            return
        self._since_keyframe = 0
        k = covering_keyframe(self._store, frame, T, self._reference.keyframe.id)
        if k != self._reference.keyframe.id:
            self._next_reference = partial(stored_reference, self._store, k, self._config)
