"""What odometry says of a frame in the world: its pose, how sure that is, and what follows from it."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.config import TrackerConfig
from hsslam_node.geometry.pose_covariance import in_world, turned
from hsslam_node.geometry.se3 import inverse, so3_log
from hsslam_node.odometry.reading import Motion
from hsslam_node.tracking.alignment import Alignment

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

    def covariance(self, of_last: np.ndarray) -> np.ndarray:
        """[6, 6] in the world, from that of the last aligned frame [6, 6]."""
        lever_m = self.T_world_cam[:3, 3] - self._last_centre()
        return in_world(self.doubt, of_last, lever_m)

    def _last_centre(self) -> np.ndarray:
        return (self.T_world_cam @ inverse(self.motion.T_from_to))[:3, 3]

    def _distance(self, T_world_cam: np.ndarray) -> float:
        """Squared Mahalanobis distance of a pose [4, 4] from the expected one."""
        turn = T_world_cam[:3, :3] @ self.T_world_cam[:3, :3].T
        way = np.concatenate([T_world_cam[:3, 3] - self.T_world_cam[:3, 3], so3_log(turn)])
        return float(way @ np.linalg.solve(self.doubt, way))
