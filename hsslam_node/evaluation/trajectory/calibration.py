"""Compares the errors of poses with their covariances."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from hsslam_node.geometry.se3 import inverse, so3_log

_SHARE = 0.95
_WITHIN = float(chi2.ppf(_SHARE, 6))  # squared Mahalanobis distance of the 95 % ellipsoid


@dataclass(frozen=True)
class Calibration:
    """Of the errors of n poses. A factor of 1 is right; above 1 the covariances are too small."""

    poses: int
    inside: float  # share inside the 95 % ellipsoid; 0.95 is right
    variance_factor: float  # mean squared Mahalanobis distance over its expectation, 6
    sigma_m: float  # median standard deviation of the position, root of its trace
    rms_m: float  # of the position's error


def calibration(
    T_world_cam: np.ndarray, T_truth: np.ndarray, covariances: np.ndarray
) -> Calibration:
    """Compare poses [n, 4, 4] as published with the truth [n, 4, 4] in the same world.

    covariances: [n, 6, 6] of translation (m) and of rotation (rad) about the centre, world axes, none
    singular.
    """
    errors = np.stack([_error(*pair) for pair in zip(T_world_cam, T_truth, strict=True)])  # [n, 6]
    squared = np.einsum("ni,ni->n", errors, np.linalg.solve(covariances, errors[..., None])[..., 0])
    variances = np.trace(covariances[:, :3, :3], axis1=1, axis2=2)
    return Calibration(
        poses=len(errors),
        inside=float((squared < _WITHIN).mean()),
        variance_factor=float(squared.mean() / 6),
        sigma_m=float(np.sqrt(np.median(variances))),
        rms_m=float(np.sqrt((errors[:, :3] ** 2).sum(1).mean())),
    )


def _error(T: np.ndarray, T_true: np.ndarray) -> np.ndarray:
    """[6] from the true pose to the estimated one; m, rad, world axes."""
    turn = T[:3, :3] @ inverse(T_true)[:3, :3]
    return np.concatenate([T[:3, 3] - T_true[:3, 3], so3_log(turn)])
