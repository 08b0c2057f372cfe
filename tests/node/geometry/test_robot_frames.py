"""The robot's frames: axes of ROS, a camera that is mounted anywhere, covariances and speeds."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.errors import UserError
from hsslam_node.geometry.floor_pose import FloorFrames
from hsslam_node.geometry.robot_frames import RobotFrames, velocity
from hsslam_node.geometry.se3 import (
    inverse,
    moved_about_camera,
    quaternion_from_rotation,
    se3_exp,
    so3_log,
)

_TILTED = se3_exp(np.array([0.3, -0.1, 0.5, 0.2, -0.3, 0.4])) @ RobotFrames().T_base_cam


def _numbers(T: np.ndarray) -> tuple[float, ...]:
    return (*T[:3, 3], *quaternion_from_rotation(T[:3, :3]))


def test_a_camera_that_looks_ahead_turns_its_axes_into_those_of_a_robot():
    R = RobotFrames().T_base_cam[:3, :3]
    np.testing.assert_allclose(R @ [0, 0, 1], [1, 0, 0], atol=1e-12)  # forward
    np.testing.assert_allclose(R @ [-1, 0, 0], [0, 1, 0], atol=1e-12)  # left
    np.testing.assert_allclose(R @ [0, -1, 0], [0, 0, 1], atol=1e-12)  # up


def test_a_step_forward_of_the_camera_is_one_of_the_robot():
    T_world_cam = np.eye(4)
    T_world_cam[:3, 3] = 0, 0, 0.5
    np.testing.assert_allclose(RobotFrames().base_pose(T_world_cam)[:3, 3], [0.5, 0, 0], atol=1e-12)


def test_a_robot_that_turns_on_the_spot_stays_in_the_origin():
    frames = RobotFrames.mounted((0.4, 0.0, 0.3, -0.5, 0.5, -0.5, 0.5))
    turn = se3_exp(np.array([0, 0, 0, 0, 0, 1.0]))  # about z of base_link
    T_world_cam = inverse(frames.T_base_cam) @ turn @ frames.T_base_cam
    assert np.linalg.norm(T_world_cam[:3, 3]) > 0.3
    np.testing.assert_allclose(frames.base_pose(T_world_cam), turn, atol=1e-12)


def test_the_robot_begins_in_the_origin_wherever_its_camera_is():
    frames = RobotFrames.mounted(_numbers(_TILTED))
    np.testing.assert_allclose(frames.T_base_cam, _TILTED, atol=1e-12)
    np.testing.assert_allclose(frames.base_pose(np.eye(4)), np.eye(4), atol=1e-12)


def test_a_robot_in_the_world_of_another_stands_where_locate_has_it():
    other = se3_exp(np.array([0.1, 0.4, 0.2, 0.0, 0.0, 0.7])) @ RobotFrames().T_base_cam
    T_world_cam = se3_exp(np.array([1.0, 2.0, -1.0, 0.1, 0.8, -0.1]))
    T = RobotFrames(_TILTED, other).base_pose(T_world_cam)
    at = FloorFrames(other, _TILTED).pose_of(T_world_cam)
    np.testing.assert_allclose(T[:2, 3], (at.x_m, at.y_m), atol=1e-12)
    np.testing.assert_allclose(inverse(other) @ T @ _TILTED, T_world_cam, atol=1e-12)


@pytest.mark.parametrize("level", [None, se3_exp(np.array([0, 0, 0, 0.5, 1.0, -0.7]))])
def test_the_covariance_is_that_of_the_base(level):
    frames = RobotFrames(_TILTED, level)
    rng = np.random.default_rng(0)
    A = rng.normal(size=(6, 6)) * 1e-3
    covariance = A @ A.T
    T_world_cam = se3_exp(np.array([1.0, 2.0, -1.0, 0.4, 0.8, -0.2]))
    T_map_base = frames.base_pose(T_world_cam)
    errors = []
    for step in rng.multivariate_normal(np.zeros(6), covariance, 20_000):
        T = frames.base_pose(moved_about_camera(T_world_cam, step))
        turn = so3_log(T[:3, :3] @ T_map_base[:3, :3].T)
        errors.append(np.concatenate([T[:3, 3] - T_map_base[:3, 3], turn]))
    found, expected = np.cov(np.array(errors).T), frames.base_covariance(covariance, T_world_cam)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(found / scale, expected / scale, atol=0.05)


@given(st.lists(st.floats(-2, 2), min_size=6, max_size=6), st.floats(0.01, 1.0))
def test_a_velocity_leads_from_one_pose_to_the_other(twist, seconds):
    start = se3_exp(np.array([0.1, 0.2, 0.3, 0.5, -0.4, 0.2]))
    end = start @ se3_exp(seconds * np.array(twist))
    np.testing.assert_allclose(velocity(start, end, seconds), twist, atol=1e-6)


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ((1.0, 2.0), "--base-T-camera 1 2: expected 7 numbers: x y z qx qy qz qw"),
        ((0.0, 0.0, np.nan, 0.0, 0.0, 0.0, 1.0), "expected 7 numbers"),
        ((0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0), "norm 2: expected a unit quaternion"),
    ],
)
def test_a_mount_that_is_none_is_refused(numbers, words):
    with pytest.raises(UserError, match=words):
        RobotFrames.mounted(numbers)
