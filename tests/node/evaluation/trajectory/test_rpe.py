"""Relative pose error."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hsslam_node.evaluation.trajectory.rpe import rpe_per_frame, rpe_per_metre, rpe_per_second
from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.geometry.trajectory import Trajectory
from tests.node.evaluation.trajectory.trajectories import shaken, walk

TWIST = st.lists(st.floats(-3, 3), min_size=6, max_size=6).map(np.array)


@settings(max_examples=20)
@given(TWIST)
def test_where_the_world_lies_does_not_matter(xi):
    truth = walk(40)
    estimate = shaken(truth)
    moved = Trajectory(estimate.stamps_ns, se3_exp(xi) @ estimate.T_world_cam)
    for measure in (rpe_per_frame, lambda e, t: rpe_per_second(e, t, 0.5)):
        found, expected = measure(moved, truth), measure(estimate, truth)
        assert found.translation_rmse_m == pytest.approx(expected.translation_rmse_m, abs=1e-9)
        assert found.rotation_rmse_deg == pytest.approx(expected.rotation_rmse_deg, abs=1e-6)
        assert found.pairs == expected.pairs


def test_a_steady_drift_grows_with_the_step():
    truth = Trajectory(walk(91).stamps_ns, np.tile(np.eye(4), (91, 1, 1)))
    poses = truth.T_world_cam.copy()
    poses[:, 0, 3] = 0.001 * np.arange(91)
    drifting = Trajectory(truth.stamps_ns, poses)
    frame, second = rpe_per_frame(drifting, truth), rpe_per_second(drifting, truth)
    assert (frame.translation_mean_m, frame.pairs) == (pytest.approx(0.001), 90)
    assert (second.translation_mean_m, second.pairs) == (pytest.approx(0.030), 61)
    assert second.rotation_max_deg == pytest.approx(0)


def test_a_turn_is_measured_in_degrees():
    truth = Trajectory(walk(3).stamps_ns, np.tile(np.eye(4), (3, 1, 1)))
    poses = truth.T_world_cam.copy()
    poses[1:] = poses[1:] @ se3_exp(np.array([0, 0, 0, 0, 0, np.deg2rad(5)]))
    found = rpe_per_frame(Trajectory(truth.stamps_ns, poses), truth)
    assert found.rotation_max_deg == pytest.approx(5)
    assert found.rotation_mean_deg == pytest.approx(2.5)


def test_a_metre_is_of_true_path():
    truth = Trajectory(np.arange(11) * 10**8, np.tile(np.eye(4), (11, 1, 1)))
    truth.T_world_cam[:, 0, 3] = 0.25 * np.arange(11)
    poses = truth.T_world_cam.copy()
    poses[:, 0, 3] *= 1.02
    found = rpe_per_metre(Trajectory(truth.stamps_ns, poses), truth)
    assert (found.translation_max_m, found.pairs) == (pytest.approx(0.02), 7)


def test_too_short_a_trajectory_has_no_pair():
    truth = walk(1)
    for measure in (rpe_per_frame, rpe_per_second, rpe_per_metre):
        assert np.isnan(measure(truth, truth).translation_rmse_m)
        assert measure(truth, truth).pairs == 0
