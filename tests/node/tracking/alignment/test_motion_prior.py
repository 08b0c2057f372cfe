"""Weak directions stay at the prediction, strong ones follow the data."""

import numpy as np
import pytest

from hsslam_node.geometry.se3 import moved_about_camera, se3_exp
from hsslam_node.tracking.alignment.motion_prior import with_motion_prior

START = se3_exp(np.array([0.4, -0.2, 1.0, 0.3, -0.2, 0.5]))


@pytest.mark.parametrize(("sigma_m", "share"), [(0.0005, 1.0), (0.005, 0.5), (0.05, 0.0)])
def test_a_direction_counts_as_well_as_the_data_know_it(sigma_m, share):
    """The data ask for 3 cm along an axis that they know to sigma; all others they know well."""
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    information = np.diag([1e8] * 6 + [1.0, 1.0])
    information[:3, :3] += (sigma_m**-2 - 1e8) * np.outer(axis, axis)
    wanted = np.zeros(8)
    wanted[:3] = 0.03 * axis + np.array([0.0, 0.01, 0.01])
    H, b = information.copy(), -information @ wanted
    H, b = with_motion_prior(H, b, START, START, 0.005)
    step = np.linalg.solve(H, -b)
    assert step[:3] @ axis == pytest.approx(share * (wanted[:3] @ axis), abs=4e-4)
    across = np.eye(3) - np.outer(axis, axis)
    np.testing.assert_allclose(across @ step[:3], across @ wanted[:3], atol=1e-5)


def test_it_is_the_prediction_that_holds_not_the_pose_of_the_last_step():
    """Once astray along a weak direction, the next step leads back, rotations too."""
    way = np.array([0.02, -0.01, 0.03, 0.01, 0.02, -0.01])
    astray = moved_about_camera(START, way)
    H, b = np.diag([1.0] * 6 + [1.0, 1.0]), np.zeros(8)
    H, b = with_motion_prior(H, b, astray, START, 0.005)
    step = np.linalg.solve(H, -b)
    np.testing.assert_allclose(step[:6], -way, atol=2e-4)
