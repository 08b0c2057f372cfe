"""Whether covariances are right, found from errors that are drawn from them."""

import numpy as np

from hsslam_node.evaluation.trajectory.calibration import calibration
from hsslam_node.geometry.se3 import moved_about_camera, se3_exp

_POSES = 2000


def _drawn(factor: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    truth = np.stack([se3_exp(x) for x in rng.normal(size=(_POSES, 6))])
    A = rng.normal(size=(_POSES, 6, 6)) * 1e-3
    covariances = A @ A.transpose(0, 2, 1) + 1e-8 * np.eye(6)
    steps = [rng.multivariate_normal(np.zeros(6), factor * one) for one in covariances]
    poses = [moved_about_camera(T, step) for T, step in zip(truth, steps, strict=True)]
    return np.stack(poses), truth, covariances


def test_right_covariances_hold_95_percent():
    found = calibration(*_drawn(1.0))
    assert found.poses == _POSES
    assert abs(found.inside - 0.95) < 0.015 and abs(found.variance_factor - 1) < 0.05


def test_covariances_that_are_too_small_show():
    found = calibration(*_drawn(4.0))
    assert found.inside < 0.6 and abs(found.variance_factor - 4) < 0.2
