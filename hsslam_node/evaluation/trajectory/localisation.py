"""A camera in a saved map: the errors of its poses while it sees what the map has seen."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hsslam_node.evaluation.mesh.visibility import Views
from hsslam_node.evaluation.trajectory.mean_transform import mean_transform
from hsslam_node.frame import Frame
from hsslam_node.geometry.projection import world_points
from hsslam_node.geometry.se3 import inverse, so3_log
from hsslam_node.geometry.trajectory import Trajectory

WITHIN_M, WITHIN_DEG = 0.02, 1.0
_OVERLAP = 0.5  # of a frame's measured pixels that the map's keyframes saw
_STRIDE_PX = 8


@dataclass(frozen=True)
class LocalisationScore:
    """Poses against the truth, aligned over the map's keyframes."""

    frames: int
    overlapping: int  # half of their measured pixels show what the map's keyframes saw
    lost: int  # of the overlapping
    outside: int  # of the overlapping: with a pose, but more than 2 cm or 1 degree off
    median_m: float  # of the overlapping
    max_m: float
    median_deg: float
    max_deg: float
    elsewhere: int  # not overlapping, with a pose
    elsewhere_max_m: float

    @property
    def all_within(self) -> bool:
        """Whether every overlapping frame has a pose within 2 cm and 1 degree."""
        return self.overlapping > 0 and self.lost == 0 and self.outside == 0


def overlaps(frames: Sequence[Frame], T_world_cam: np.ndarray, views: Views) -> np.ndarray:
    """Which frames, at true poses [n, 4, 4], see mostly what `views` saw: [n] bool."""
    seen = (
        world_points(frame.depth_m(), frame.camera, T, _STRIDE_PX)
        for frame, T in zip(frames, T_world_cam, strict=True)
    )
    return np.array([len(p) > 0 and views.observed(p).mean() >= _OVERLAP for p in seen], bool)


def localisation_score(
    estimate: Trajectory, truth: Trajectory, overlapping: np.ndarray, T_truth_map: np.ndarray
) -> LocalisationScore:
    """Score the poses of a camera in a map.

    Args:
        estimate: in the world of the map; lost frames are left out.
        truth: of all frames.
        overlapping: [n] bool, of `truth`.
        T_truth_map: [4, 4], from `map_in_truth`.
    """
    pose_of = dict(zip(estimate.stamps_ns.tolist(), estimate.T_world_cam, strict=True))
    found = [pose_of.get(stamp) for stamp in truth.stamps_ns.tolist()]
    has_pose = np.array([T is not None for T in found], bool)
    error = np.full((len(found), 2), np.nan)
    for k in np.flatnonzero(has_pose):
        step = inverse(truth.T_world_cam[k]) @ T_truth_map @ found[k]
        error[k] = (
            np.linalg.norm(step[:3, 3]),
            np.rad2deg(np.linalg.norm(so3_log(step[:3, :3]))),
        )
    counted, others = error[overlapping & has_pose], error[~overlapping & has_pose]
    worst = counted.max(axis=0, initial=0.0)
    middle = np.median(counted, axis=0) if len(counted) else np.full(2, np.nan)
    return LocalisationScore(
        frames=len(found),
        overlapping=int(overlapping.sum()),
        lost=int((overlapping & ~has_pose).sum()),
        outside=int((counted > (WITHIN_M, WITHIN_DEG)).any(axis=1).sum()),
        median_m=float(middle[0]),
        max_m=float(worst[0]),
        median_deg=float(middle[1]),
        max_deg=float(worst[1]),
        elsewhere=len(others),
        elsewhere_max_m=float(others[:, 0].max(initial=0.0)),
    )


def map_in_truth(keyframes: Trajectory, truth: Trajectory) -> np.ndarray:
    """T_truth_map [4, 4] by the keyframes of the map that have a true pose."""
    _, ours, theirs = np.intersect1d(keyframes.stamps_ns, truth.stamps_ns, return_indices=True)
    return mean_transform(keyframes.T_world_cam[ours], truth.T_world_cam[theirs])
