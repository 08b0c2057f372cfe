"""Poses on the floor belong to cameras, whatever their tilt and place on the robot."""

import numpy as np
import pytest

from hsslam_node.geometry.floor_pose import FloorFrames, FloorPose
from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.geometry.se3 import so3_exp, transform

_ROBOT = RobotFrames.mounted([0.2, 0.1, 0.4, -0.5, 0.5, -0.5, 0.5])


def _camera(frames: FloorFrames, x: float, y: float, yaw_deg: float, pitch_deg: float = 0.0):
    """T_world_cam of a robot in the frame of the floor, 0.3 m over it, nose down by the pitch."""
    T = transform(np.array([x, y, 0.3]), np.array([0.0, 0, 0, 1]))
    yaw, pitch = np.deg2rad([yaw_deg, pitch_deg])
    T[:3, :3] = so3_exp(np.array([0, 0, yaw])) @ so3_exp(np.array([0, pitch, 0]))
    return np.linalg.inv(frames.T_floor_world) @ T @ frames.T_base_cam


_FRAMES = (
    FloorFrames(RobotFrames().T_base_cam),
    FloorFrames(_ROBOT.T_base_cam, _ROBOT.T_base_cam),
)


@pytest.mark.parametrize("frames", _FRAMES)
def test_a_pose_takes_height_and_tilt_of_the_camera_that_stands_most_like_it(frames):
    known = np.stack([_camera(frames, 0, 0, 0, 30), _camera(frames, 2, 1, 90, 10)])
    T = frames.camera_at(FloorPose(1.8, 1.3, np.deg2rad(120)), known)
    np.testing.assert_allclose(T, _camera(frames, 1.8, 1.3, 120, 10), atol=1e-12)
    at = frames.pose_of(T)
    assert (at.x_m, at.y_m, np.rad2deg(at.yaw_rad)) == pytest.approx((1.8, 1.3, 120))


def test_a_first_camera_stands_in_the_origin_and_looks_along_x():
    at = FloorFrames(RobotFrames().T_base_cam).pose_of(np.eye(4))
    assert (at.x_m, at.y_m, at.yaw_rad) == pytest.approx((0, 0, 0))
    right = transform(np.array([1.0, 0.0, 2.0]), np.array([0, np.sin(0.2), 0, np.cos(0.2)]))
    at = FloorFrames(RobotFrames().T_base_cam).pose_of(right)  # x right, z ahead, turned right
    assert (at.x_m, at.y_m, at.yaw_rad) == pytest.approx((2, -1, -0.4))


@pytest.mark.parametrize("pitch_deg", [-90, -45, 0, 45, 90])
def test_a_camera_that_looks_down_or_up_still_has_a_yaw(pitch_deg):
    frames = FloorFrames(RobotFrames().T_base_cam)
    at = frames.pose_of(_camera(frames, 1, 2, 70, pitch_deg))
    assert np.rad2deg(at.yaw_rad) == pytest.approx(70)


def test_a_turn_is_the_shorter_way():
    one, other = (FloorPose(0, 0, np.deg2rad(yaw)) for yaw in (170, -170))
    assert np.rad2deg(one.turn_rad(other)) == pytest.approx(20)
