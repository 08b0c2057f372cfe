"""Relative pose error: drift over a fixed step, which no alignment of the world can hide."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.evaluation.trajectory.ate import associated
from hsslam_node.geometry.se3 import inverse, so3_log
from hsslam_node.geometry.trajectory import Trajectory


@dataclass(frozen=True)
class RpeResult:
    """Error of the motion over a step, translation in m and rotation in degrees; NaN without a pair."""

    translation_rmse_m: float
    translation_mean_m: float
    translation_max_m: float
    rotation_rmse_deg: float
    rotation_mean_deg: float
    rotation_max_deg: float
    pairs: int


def rpe_per_frame(estimate: Trajectory, truth: Trajectory, frames: int = 1) -> RpeResult:
    """Error of the motion from every scored pose to the one that comes `frames` scored poses later.

    Source: Sturm et al., A Benchmark for the Evaluation of RGB-D SLAM Systems (2012).
    """
    paired = associated(estimate, truth)
    first = np.arange(max(len(paired[0]) - frames, 0))
    return _errors(*paired, first, first + frames)


def rpe_per_second(estimate: Trajectory, truth: Trajectory, seconds: float = 1.0) -> RpeResult:
    """Error of the motion from every scored pose to the first that comes `seconds` later or more."""
    paired = associated(estimate, truth)
    stamps_ns = paired[1].stamps_ns
    half_step_ns = 1_000_000  # stamps of 30 Hz are rounded: 30 of them may miss a second by some ns
    last = np.searchsorted(stamps_ns, stamps_ns + round(seconds * 1e9) - half_step_ns)
    first = np.flatnonzero(last < len(stamps_ns))
    return _errors(*paired, first, last[first])


def rpe_per_metre(estimate: Trajectory, truth: Trajectory, metres: float = 1.0) -> RpeResult:
    """Error of the motion from every scored pose to the first that lies `metres` of true path ahead."""
    paired = associated(estimate, truth)
    steps = np.linalg.norm(np.diff(paired[1].positions, axis=0), axis=1)
    path_m = np.concatenate([[0.0], np.cumsum(steps)])[: len(paired[1])]
    last = np.searchsorted(path_m, path_m + metres)
    first = np.flatnonzero(last < len(path_m))
    return _errors(*paired, first, last[first])


def _errors(
    estimate: Trajectory, truth: Trajectory, first: np.ndarray, last: np.ndarray
) -> RpeResult:
    translations_m, rotations_rad = np.empty(len(first)), np.empty(len(first))
    for row, (i, j) in enumerate(zip(first, last, strict=True)):
        moved = inverse(estimate.T_world_cam[i]) @ estimate.T_world_cam[j]
        truly = inverse(truth.T_world_cam[i]) @ truth.T_world_cam[j]
        error = inverse(truly) @ moved
        translations_m[row] = np.linalg.norm(error[:3, 3])
        rotations_rad[row] = np.linalg.norm(so3_log(error[:3, :3]))
    return RpeResult(*_stats(translations_m), *_stats(np.rad2deg(rotations_rad)), len(first))


def _stats(values: np.ndarray) -> tuple[float, float, float]:
    if len(values) == 0:
        return float("nan"), float("nan"), float("nan")
    return float(np.sqrt(np.mean(values**2))), float(values.mean()), float(values.max())
