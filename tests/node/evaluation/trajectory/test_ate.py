"""Absolute trajectory error."""

import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.evaluation.trajectory.ate import align, ate
from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.geometry.trajectory import Trajectory

TWIST = st.lists(st.floats(-3, 3), min_size=6, max_size=6).map(np.array)


def trajectory(n: int = 50, seed: int = 0) -> Trajectory:
    rng = np.random.default_rng(seed)
    poses = np.array([se3_exp(rng.normal(size=6)) for _ in range(n)])
    return Trajectory(np.arange(n, dtype=np.int64) * 33_333_333, poses)


@given(TWIST)
def test_a_rigid_motion_of_the_world_is_no_error(xi):
    truth, T = trajectory(), se3_exp(xi)
    result = ate(Trajectory(truth.stamps_ns, T @ truth.T_world_cam), truth)
    assert result.rmse_m < 1e-9
    np.testing.assert_allclose(result.T_truth_estimate @ T, np.eye(4), atol=1e-9)


def test_scale_is_not_aligned():
    truth = trajectory()
    poses = truth.T_world_cam.copy()
    poses[:, :3, 3] *= 1.1
    assert ate(Trajectory(truth.stamps_ns, poses), truth).rmse_m > 0.05


def test_the_error_is_the_one_that_was_put_in():
    truth, rng = trajectory(2000), np.random.default_rng(1)
    poses = truth.T_world_cam.copy()
    poses[:, :3, 3] += rng.normal(0, 0.01, (2000, 3))
    result = ate(Trajectory(truth.stamps_ns, poses), truth)
    assert result.rmse_m == pytest.approx(0.01 * np.sqrt(3), rel=0.05)
    assert result.mean_m < result.rmse_m < result.max_m


def test_lost_frames_are_missing_from_scored():
    truth = trajectory()
    kept = Trajectory(truth.stamps_ns[::2], truth.T_world_cam[::2])
    result = ate(kept, truth)
    assert (result.scored, result.expected) == (25, 50)


def test_stamps_too_far_apart_are_not_paired():
    truth = trajectory()
    shifted = Trajectory(truth.stamps_ns + 15_000_000, truth.T_world_cam)
    assert ate(shifted, truth).scored == 50
    assert ate(shifted, truth, max_dt_s=0.01).scored == 0
    assert np.isnan(ate(shifted, truth, max_dt_s=0.01).rmse_m)


def test_order_does_not_matter():
    truth = trajectory()
    back = Trajectory(truth.stamps_ns[::-1], truth.T_world_cam[::-1])
    assert ate(back, truth).rmse_m < 1e-9


def test_a_straight_line_is_aligned_without_a_warning():
    line = np.arange(5.0)[:, None] * [1, 0, 0]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        T = align(line, line[:, [1, 0, 2]] + 3)
    np.testing.assert_allclose(line @ T[:3, :3].T + T[:3, 3], line[:, [1, 0, 2]] + 3, atol=1e-12)


def test_a_mirrored_world_is_not_a_rotation():
    points = np.random.default_rng(0).normal(size=(30, 3))
    T = align(points, points * [1, 1, -1])
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1)


@pytest.mark.parametrize("step_m", [0.0, 0.05], ids=["turns", "walks straight"])
def test_what_a_narrow_path_places_is_not_turned_by_its_noise(step_m: float):
    """A mesh 3 m away, by poses with a noise of 0.2 mm; positions alone leave a turn free."""
    rng, n = np.random.default_rng(2), 30
    truth = [se3_exp(np.array([step_m * k, 0, 0, 0, 0.01 * k, 0])) for k in range(n)]
    poses = np.stack(truth)
    poses[:, 0, 3], poses[:, 1:3, 3] = step_m * np.arange(n), 0.0
    noisy = poses.copy()
    noisy[:, :3, 3] += rng.normal(0, 2e-4, (n, 3))
    stamps = np.arange(n, dtype=np.int64) * 33_333_333
    result = ate(Trajectory(stamps, noisy), Trajectory(stamps, poses))
    placed = result.T_truth_estimate @ np.array([1.0, 2.0, 3.0, 1.0])
    np.testing.assert_allclose(placed[:3], [1.0, 2.0, 3.0], atol=1e-3)
    assert result.rmse_m < 4e-4
