"""The search for the pose of one frame: by odometry, from guesses of its motion, by relocalisation."""

from collections.abc import Callable, Iterator

import numpy as np

from hsslam_node.config import TrackerConfig
from hsslam_node.tracking.aligned.acceptance import is_acceptable, is_confirmed
from hsslam_node.tracking.aligned.observation import Observation
from hsslam_node.tracking.aligned.reference import Reference
from hsslam_node.tracking.aligned.reference_aligner import ReferenceAligner
from hsslam_node.tracking.alignment.align import Alignment
from hsslam_node.tracking.dead_reckoning import DeadReckoning, Reckoning
from hsslam_node.tracking.motion import CameraMotion
from hsslam_node.tracking.odometry import rgbd_odometry
from hsslam_node.tracking.places.relocalisation import Place, Relocalisation

FOLLOWED_FRAMES = 3  # frames after the last good one that RGB-D odometry compares with it
_UNALIGNED_FRAMES = 10  # dead-reckoned frames with depth, after which relocalisation starts


class PoseSearch:
    """Aligns a frame from one guess after the other until an alignment is accepted.

    The aligner then keeps the reference keyframe of this alignment. If no alignment is accepted, or an error
    ends the search, it keeps the reference from before.
    """

    def __init__(
        self,
        config: TrackerConfig,
        aligner: ReferenceAligner,
        motion: CameraMotion,
        reckoned: DeadReckoning,
        relocalisation: Relocalisation,
    ) -> None:
        self._config = config
        self._aligner = aligner
        self._motion = motion
        self._reckoned = reckoned
        self._relocalisation = relocalisation
        # whether relocalisation placed the last aligned frame, so its motion is not known
        self.is_at_place = False

    def from_motion(
        self, seen: Observation, prediction: np.ndarray, reckoning: Reckoning | None
    ) -> Alignment | None:
        """The alignment of a frame, or None if none is accepted.

        Args:
            prediction: T_world_cam [4, 4] by the camera's motion.
            reckoning: the pose by odometry; None: odometry has none.

        Raises:
            TornMapError: the map was overwritten meanwhile.
        """
        if reckoning is not None:
            found = self._found_or_undone(lambda: self._by_odometry(seen, reckoning))
            if found is not None:
                return found
            if reckoning.is_within_reach(self._config) and not seen.has_depth:
                return None  # dead reckoning gives the pose
        return self._found_or_undone(lambda: self._by_guesses(seen, prediction))

    def at_place(self, seen: Observation, place: Place) -> Alignment | None:
        """The alignment of a frame at a place, None if it does not fit.

        Raises:
            TornMapError: the map was overwritten meanwhile.
        """
        return self._found_or_undone(lambda: self._by_place(seen, place))

    def _found_or_undone(self, search: Callable[[], Alignment | None]) -> Alignment | None:
        """Run a search; restore the reference if it finds nothing or raises."""
        before, found = self._aligner.reference, None
        try:
            found = search()
        finally:
            if found is None:
                self._aligner.reference = before
        reference = self._aligner.reference
        self.is_at_place = (
            reference is not None and reference is not before and reference.is_at_place
        )
        return found

    def _by_place(self, seen: Observation, place: Place) -> Alignment | None:
        self._aligner.reference = Reference(place.reference, is_at_place=True)
        best = self._aligner.align(seen, place.T_world_cam)
        return best if self._is_acceptable(seen, best, place.T_world_cam, after_gap=True) else None

    def _by_odometry(self, seen: Observation, reckoning: Reckoning) -> Alignment | None:
        """Align near the pose by odometry; after dead-reckoned frames, to the keyframe that shows most."""
        T = reckoning.T_world_cam
        if self._reckoned.is_on and seen.has_depth:
            self._aligner.refer_to_covering(seen.frame, T)
        best = self._aligner.align(seen, T, reckoning.doubt)
        if best is None:
            return None
        if not reckoning.is_sure:
            after_gap = self._motion.is_after_gap(seen.frame.stamp_ns)
            fits = self._is_acceptable(seen, best, T, after_gap)
            return best if fits and self._is_confirmed(seen, best, None) else None
        fits = self._is_acceptable(seen, best, T, after_gap=False)
        if fits and self._is_confirmed(seen, best, T):
            return best
        return best if reckoning.agrees(best, self._config) and not seen.localise_only else None

    def _by_guesses(self, seen: Observation, prediction: np.ndarray) -> Alignment | None:
        """The first alignment from a guess that is accepted."""
        before, stamp_ns = self._aligner.reference, seen.frame.stamp_ns
        expected = prediction if self._motion.is_foreseen(stamp_ns) else None
        after_gap = self._motion.is_after_gap(stamp_ns)
        for guess in self._guesses(seen, prediction, is_unforeseen=expected is None):
            best = self._aligner.align(seen, guess)
            if best is None or not self._is_acceptable(seen, best, guess, after_gap):
                continue
            is_at_place = self._aligner.reference is not before  # relocalisation has checked it
            if is_at_place or self._is_confirmed(seen, best, expected):
                return best
        return None

    def _guesses(
        self, seen: Observation, prediction: np.ndarray, *, is_unforeseen: bool
    ) -> Iterator[np.ndarray]:
        """In this order: after a gap, the motion extrapolated over all of it; the prediction; the last pose;
        OpenCV's RGB-D odometry from the last good frame; after a gap or if lost, a relocalised pose."""
        motion, reckoned, frame = self._motion, self._reckoned, seen.frame
        T_last = motion.T_world_last
        if is_unforeseen and motion.is_known:
            yield motion.predicted(frame.stamp_ns, longest=np.inf)
        yield prediction
        if motion.is_known:
            yield T_last
        if motion.lost_frames + reckoned.unaligned_frames < FOLLOWED_FRAMES:
            T_last_cam = rgbd_odometry(motion.last.frame, frame)
            if T_last_cam is not None:
                yield T_last @ T_last_cam
        is_reckoned = reckoned.is_on and motion.lost_frames == 0
        if not is_unforeseen or (is_reckoned and reckoned.unaligned_frames < _UNALIGNED_FRAMES):
            return
        may_look_alike = motion.may_be_elsewhere(frame.stamp_ns)
        for place in self._relocalisation.places(frame, may_look_alike=may_look_alike):
            self._aligner.reference = Reference(place.reference, is_at_place=True)
            yield place.T_world_cam

    def _is_acceptable(
        self, seen: Observation, alignment: Alignment | None, guess: np.ndarray, after_gap: bool
    ) -> bool:
        return is_acceptable(
            alignment, guess, after_gap=after_gap, localise_only=seen.localise_only,
            config=self._config,
        )  # fmt: skip

    def _is_confirmed(
        self, seen: Observation, best: Alignment, expected: np.ndarray | None
    ) -> bool:
        last, T_world_last = self._motion.last, self._motion.T_world_last
        longest_gap_s = self._config.longest_gap_s
        return is_confirmed(
            best.T_world_cam, expected, seen.frame, last, T_world_last, longest_gap_s
        )
