"""Frames whose poses the robot's odometry tells: where they are, how sure that is, the gap they leave."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.config import TrackerConfig
from hsslam_node.geometry.pose_covariance import carried, in_world, turned
from hsslam_node.geometry.se3 import inverse, so3_log
from hsslam_node.odometry.reading import Motion, MotionSince, OdometryReading
from hsslam_node.tracking.alignment.align import Alignment

_SURE_M, _SURE_RAD = 0.025, 0.025  # standard deviations: twice that is near the prediction
_FARTHEST = 25.0  # squared Mahalanobis distance of 6 numbers: one in 3000 is beyond


@dataclass(frozen=True)
class Reckoning:
    """A pose by odometry since the last frame that was aligned."""

    T_world_cam: np.ndarray  # [4, 4]
    doubt: np.ndarray  # [6, 6] of the motion alone, as of `moved_about_camera`
    motion: Motion

    @classmethod
    def after(cls, T_world_last: np.ndarray, motion: Motion) -> "Reckoning":
        """From the pose [4, 4] of the last frame that was aligned."""
        T = T_world_last @ motion.T_from_to
        return cls(T, turned(motion.covariance, T[:3, :3]), motion)

    @property
    def is_sure(self) -> bool:
        """Whether an alignment elsewhere is known to be wrong."""
        return self.motion.is_surer_than(_SURE_M, _SURE_RAD)

    def is_within_reach(self, config: TrackerConfig) -> bool:
        """Whether a pose by odometry alone is still published."""
        return self.motion.is_surer_than(config.odometry_reach_m, config.odometry_reach_rad)

    def agrees(self, alignment: Alignment | None, config: TrackerConfig) -> bool:
        """Whether the alignment fits the little that the keyframe shows of the frame, where odometry expects
        it: enough for a camera that comes back from where no keyframe looks."""
        return (
            alignment is not None
            and bool(np.isfinite(alignment.T_world_cam).all())
            and alignment.surface_coverage > config.odometry_coverage
            and alignment.surface_inlier_ratio > config.reference_surface_agreement
            and self._distance(alignment.T_world_cam) < _FARTHEST
        )

    @property
    def way_m(self) -> np.ndarray:
        """[3] from the last aligned frame's centre, world axes."""
        return -self.T_world_cam[:3, :3] @ inverse(self.motion.T_from_to)[:3, 3]

    def _distance(self, T_world_cam: np.ndarray) -> float:
        """Squared Mahalanobis distance of a pose [4, 4] from the expected one."""
        turn = T_world_cam[:3, :3] @ self.T_world_cam[:3, :3].T
        way = np.concatenate([T_world_cam[:3, 3] - self.T_world_cam[:3, 3], so3_log(turn)])
        return float(way @ np.linalg.solve(self.doubt, way))


class DeadReckoning:
    """Frames by odometry alone since the last aligned one, and the gap that they leave between keyframes."""

    def __init__(self) -> None:
        self._since = MotionSince()  # since the last aligned frame
        self._of_last = np.zeros((6, 6))  # covariance of T_world_cam of the last aligned frame
        self._gap = np.zeros((6, 6))  # `gap_at` of the last aligned frame
        self._newest: Reckoning | None = None  # of the frames since then
        self.unaligned_frames = 0  # of these, those that see something
        self.is_open = False  # whether there is no keyframe since the last frame by odometry alone

    @property
    def is_on(self) -> bool:
        """Whether the frame before this one has its pose by odometry alone."""
        return self._newest is not None

    def expected(
        self, T_world_last: np.ndarray, reading: OdometryReading | None
    ) -> Reckoning | None:
        """Where a frame with this reading was, from the pose [4, 4] of the last aligned one; None if odometry
        does not say."""
        motion = self._since.to(reading)
        return None if motion is None else Reckoning.after(T_world_last, motion)

    def add(self, reckoning: Reckoning, *, sees: bool) -> np.ndarray:
        """A frame by odometry alone, which sees something or nothing; returns the covariance [6, 6] of its
        pose in the world."""
        self._newest = reckoning
        self.unaligned_frames += sees
        self.is_open = True
        return in_world(reckoning.doubt, self._of_last, reckoning.way_m)

    def gap_at(self, T_world_last: np.ndarray, T_world_cam: np.ndarray) -> np.ndarray:
        """Covariance [6, 6] of the motion by odometry alone since the newest keyframe, as of
        `moved_about_camera`; 0 if there was none.

        Poses [4, 4] of the last aligned frame and of the one that is aligned now.
        """
        gap = carried(self._gap, T_world_cam[:3, 3] - T_world_last[:3, 3])
        if self._newest is None:
            return gap
        return gap + carried(
            self._newest.doubt, T_world_cam[:3, 3] - self._newest.T_world_cam[:3, 3]
        )

    def restart(
        self, reading: OdometryReading | None, covariance: np.ndarray, gap: np.ndarray | None
    ) -> None:
        """After an aligned frame: covariance [6, 6] of its pose in the world, its `gap_at`; None: no gap is
        left behind it."""
        self._since.restart(reading)
        self._of_last = covariance
        self._gap = np.zeros((6, 6)) if gap is None else gap
        self._newest = None
        self.unaligned_frames = 0
        self.is_open &= gap is not None
