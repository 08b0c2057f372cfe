"""Dead reckoning: poses by odometry alone, their covariances, and the gap between keyframes."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.config import TrackerConfig
from hsslam_node.geometry.fragment_place import FragmentPlace
from hsslam_node.geometry.pose_covariance import carried, in_world, turned
from hsslam_node.geometry.se3 import inverse, so3_log
from hsslam_node.odometry.reading import Motion, MotionSince, OdometryReading
from hsslam_node.tracking.alignment.align import Alignment
from hsslam_node.tracking.motion_agreement import MotionAgreement

_SURE_M, _SURE_RAD = 0.025, 0.025  # standard deviations: 2 sigma are the limits of `is_confirmed`
# standard deviations: a motion that is less sure does not show how odometry is mounted, nor where it goes on
_COMPARED_M, _COMPARED_RAD = 0.1, 0.1
_REST_M_S, _REST_RAD_S = 0.1, 0.1  # by which odometry may differ, also at rest: noise, late stamps
_FARTHEST = 25.0  # squared Mahalanobis distance of 6 numbers: one in 3000 is beyond


@dataclass(frozen=True)
class Reckoning:
    """A pose by odometry since the last aligned frame."""

    T_world_cam: np.ndarray  # [4, 4]
    doubt: np.ndarray  # [6, 6] covariance of the motion alone, as of `moved_about_camera`
    motion: Motion

    @classmethod
    def after(cls, T_world_last: np.ndarray, motion: Motion) -> "Reckoning":
        """From the pose [4, 4] of the last frame that was aligned."""
        T = T_world_last @ motion.T_from_to
        return cls(T, turned(motion.covariance, T[:3, :3]), motion)

    def moved(self, T_to_world: np.ndarray) -> "Reckoning":
        """The same in another world, to which T_to_world [4, 4] maps."""
        doubt = turned(self.doubt, T_to_world[:3, :3])
        return Reckoning(T_to_world @ self.T_world_cam, doubt, self.motion)

    @property
    def is_sure(self) -> bool:
        """Whether odometry is so sure that an alignment elsewhere must be wrong."""
        return self.motion.is_surer_than(_SURE_M, _SURE_RAD)

    def is_within_reach(self, config: TrackerConfig) -> bool:
        """Whether the pose is sure enough to be published by odometry alone."""
        return self.motion.is_surer_than(config.odometry_reach_m, config.odometry_reach_rad)

    def agrees(self, alignment: Alignment | None, config: TrackerConfig) -> bool:
        """Whether the alignment fits, even if the keyframe shows little of the frame, and is near the pose
        by odometry: enough for a camera that returns from a place that no keyframe shows."""
        return (
            alignment is not None
            and bool(np.isfinite(alignment.T_world_cam).all())
            and alignment.surface_coverage > config.odometry_coverage
            and alignment.surface_inlier_ratio > config.reference_surface_agreement
            and self._distance(alignment.T_world_cam) < _FARTHEST
        )

    @property
    def way_m(self) -> np.ndarray:
        """[3] from the centre of the last aligned frame to this one's, world axes."""
        return -self.T_world_cam[:3, :3] @ inverse(self.motion.T_from_to)[:3, 3]

    def _distance(self, T_world_cam: np.ndarray) -> float:
        """Squared Mahalanobis distance of a pose [4, 4] from the expected one."""
        turn = T_world_cam[:3, :3] @ self.T_world_cam[:3, :3].T
        twist = np.concatenate([T_world_cam[:3, 3] - self.T_world_cam[:3, 3], so3_log(turn)])
        return float(twist @ np.linalg.solve(self.doubt, twist))


class DeadReckoning:
    """Dead-reckoned frames since the last aligned one, and the gap that they leave between keyframes."""

    def __init__(self) -> None:
        self._since = MotionSince()  # since the last aligned frame
        self._agreement = MotionAgreement(_REST_M_S, _REST_RAD_S)
        self._last_covariance = np.zeros((6, 6))  # of T_world_cam of the last aligned frame
        self._gap = np.zeros((6, 6))  # `gap_at` of the last aligned frame
        self._newest: Reckoning | None = None  # of the dead-reckoned frames since then
        self.unaligned_frames = 0  # dead-reckoned frames with depth since then
        self.is_open = False  # whether no keyframe has come since the last dead-reckoned frame

    @property
    def disagrees(self) -> bool:
        """Whether odometry moves unlike the camera."""
        return self._agreement.is_known and not self._agreement.holds

    def compare(self, reckoning: Reckoning, T_last_cam: np.ndarray, seconds: float) -> None:
        """Compare odometry with the motion [4, 4] of an aligned frame since the aligned frame before it."""
        if self._since.is_from_reading and reckoning.motion.is_surer_than(
            _COMPARED_M, _COMPARED_RAD
        ):
            T_off = inverse(reckoning.motion.T_from_to) @ T_last_cam
            self._agreement.compare(_way_and_turn(T_last_cam), _way_and_turn(T_off), seconds)

    @property
    def is_on(self) -> bool:
        """Whether a frame was dead-reckoned since the last aligned one."""
        return self._newest is not None

    def expected(
        self, T_world_last: np.ndarray, reading: OdometryReading | None
    ) -> Reckoning | None:
        """The pose of a frame with this reading, from the pose [4, 4] of the last aligned frame; None if the
        motion is not known. If the last aligned frame had no reading, the motion by odometry begins at an
        earlier frame, which had one. It counts without the part up to the last aligned frame, which the
        camera saw, and only if it is sure."""
        motion = self._since.to(reading)
        if motion is None:
            return None
        if not (self._since.is_from_reading or motion.is_surer_than(_COMPARED_M, _COMPARED_RAD)):
            return None  # the last reading is too long ago
        return Reckoning.after(T_world_last, motion)

    def expected_back(
        self, reckoning: Reckoning | None, config: TrackerConfig, *, is_lost: bool
    ) -> np.ndarray | None:
        """Pose [4, 4] by odometry of the first aligned frame after dead-reckoned ones; None: there were none,
        or odometry became too unsure, so that frames were lost (`is_lost`; those without a reading also are).
        """
        if (
            reckoning is None
            or not self.is_on
            or (is_lost and not reckoning.is_within_reach(config))
        ):
            return None
        return reckoning.T_world_cam

    def add(self, reckoning: Reckoning, *, sees: bool) -> np.ndarray:
        """Take a dead-reckoned frame; `sees`: it has depth. Returns the covariance [6, 6] of its pose in the
        world."""
        self._newest = reckoning
        self.unaligned_frames += sees
        self.is_open = True
        return in_world(reckoning.doubt, self._last_covariance, reckoning.way_m)

    def gap_at(self, T_world_last: np.ndarray, T_world_cam: np.ndarray) -> np.ndarray:
        """Covariance [6, 6] of the motion by odometry alone since the newest keyframe, as of
        `moved_about_camera`; 0 if there was none.

        T_world_last, T_world_cam: poses [4, 4] of the last aligned frame and of the one aligned now.
        """
        gap = carried(self._gap, T_world_cam[:3, 3] - T_world_last[:3, 3])
        if self._newest is None:
            return gap
        return gap + carried(
            self._newest.doubt, T_world_cam[:3, 3] - self._newest.T_world_cam[:3, 3]
        )

    def restart(
        self, reading: OdometryReading | None, covariance: np.ndarray, gap: np.ndarray | None,
        T_last_cam: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        """Start at an aligned frame: `covariance` [6, 6] of its pose in the world; `gap`: its `gap_at`; None:
        no gap remains; `T_last_cam` [4, 4]: its motion since the aligned frame before it; None: not known."""
        if reading is None and T_last_cam is not None:
            self._since.begin_later(T_last_cam)
        else:
            self._since.restart(reading)
        self._last_covariance = covariance
        self._gap = np.zeros((6, 6)) if gap is None else gap
        self._newest = None
        self.unaligned_frames = 0
        self.is_open &= gap is not None

    def take_over(
        self, other: "DeadReckoning", place: FragmentPlace, T_fragment_last: np.ndarray
    ) -> None:
        """Continue from a fragment that has joined the map at `place`; T_fragment_last: pose [4, 4] of the
        last frame aligned in it."""
        T = place.T_map_fragment
        self._since = other._since
        if other._agreement.is_known:
            self._agreement = other._agreement
        self._last_covariance = place.covariance(other._last_covariance, T_fragment_last)
        self._gap = turned(other._gap, T[:3, :3])
        self._newest = None if other._newest is None else other._newest.moved(T)
        self.unaligned_frames, self.is_open = other.unaligned_frames, other.is_open


def _way_and_turn(T: np.ndarray) -> np.ndarray:
    """Length in m and angle in rad of a motion [4, 4], [2]."""
    return np.array([np.linalg.norm(T[:3, 3]), np.linalg.norm(so3_log(T[:3, :3]))])
