"""Noise of odometry by covariances of its messages: those of a filter hold more than the motion's."""

import numpy as np
import pytest

from hsslam_node.geometry.pose_covariance import carried
from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.odometry.reading import MotionSince
from hsslam_node.odometry.track import OdometryTrack

_PERIOD_NS = 20_000_000


@pytest.mark.parametrize("start", [0, 500, 4500])
def test_a_filter_is_as_sure_of_a_motion_wherever_the_robot_is(start: int):
    """An EKF of a robot that drives straight, 2 cm a message, whose heading drifts."""
    track, covariance, drift = OdometryTrack(np.eye(4), 0.0), np.zeros((6, 6)), np.zeros((6, 6))
    drift[0, 0] = drift[1, 1] = drift[5, 5] = 1e-6
    since = MotionSince()
    for k in range(start + 51):
        T = se3_exp(np.array([0.02 * k, 0.0, 0.0, 0.0, 0.0, 0.0]))
        track.add(k * _PERIOD_NS, T, covariance)
        covariance = carried(covariance, np.array([0.02, 0.0, 0.0])) + drift
        if k == start:
            since.restart(track.at(k * _PERIOD_NS))
        motion = since.to(track.at(k * _PERIOD_NS))
    assert motion is not None
    sigma_m = np.sqrt(np.linalg.eigvalsh(motion.covariance[:3, :3])[-1])
    true_m = np.sqrt(1e-6 * (50 + sum((0.02 * n) ** 2 for n in range(50))))
    assert true_m <= sigma_m < 3 * true_m
