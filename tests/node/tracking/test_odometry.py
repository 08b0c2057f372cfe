"""RGB-D odometry gives the motion between two frames, roughly, or None."""

import numpy as np

from hsslam_node.geometry.se3 import inverse
from hsslam_node.tracking.odometry import rgbd_odometry
from tests.small_room import pose_error, room_frames, room_poses, with_black


def test_motion_between_two_frames():
    frames, poses = room_frames(), room_poses()
    truth = inverse(poses[10]) @ poses[16]
    T = rgbd_odometry(frames[10], frames[16])
    assert T is not None
    distance_m, angle_deg = pose_error(T, truth)
    assert distance_m < 0.5 * np.linalg.norm(truth[:3, 3]) and angle_deg < 1.0


def test_without_depth_there_is_none():
    frame = room_frames()[10]
    assert rgbd_odometry(frame, with_black(frame)) is None
    assert rgbd_odometry(with_black(frame), frame) is None
