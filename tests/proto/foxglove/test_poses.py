"""What Foxglove shows of poses: a tree of transforms, and odometry with its covariance and speed."""

from itertools import pairwise
from typing import Any

import msgspec
import numpy as np
import pytest

from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.geometry.se3 import se3_exp, transform
from hsslam_proto.foxglove.poses import DrawnPoses, DrawnRobot
from hsslam_proto.messages import Pose
from hsslam_proto.pose_codec import covariance_matrix, pose_matrix, pose_numbers, wire_covariance
from tests.services.wire_samples import pose

_MOUNT = se3_exp(np.array([0.3, -0.1, 0.5, 0.2, -0.3, 0.4])) @ RobotFrames().T_base_cam
_LEVEL = se3_exp(np.array([0.1, 0.4, 0.2, 0.0, 0.0, 0.7])) @ RobotFrames().T_base_cam
_CHAIN = ["world", "one/map", "one/odom", "one/base_link", "camera"]


def _moved(index: int) -> Pose:
    """The odometry has drifted against the world."""
    T = se3_exp(np.array([0.1 * index, 0.0, 0.2, 0.3, -0.2, 0.1 * index]))
    t, q = (tuple(part) for part in np.split(np.array(pose_numbers(T)), [3]))
    drifted = pose_numbers(se3_exp(np.array([0.05, 0.1, 0.0, 0.1, 0.1, 0.0])) @ T)
    covariance = wire_covariance(1e-4 * np.diag([1.0, 2, 3, 4, 5, 6]))
    return msgspec.structs.replace(pose(index), t=t, q=q, odometry=drifted, covariance=covariance)


def _drawn(drawn: DrawnPoses, of: Pose) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {}
    for viz in drawn.of(of):
        found.setdefault(viz.topic, []).append(viz.schema.FromString(viz.payload))
    return found


def _matrix(t: Any, q: Any) -> np.ndarray:
    return transform(np.array([t.x, t.y, t.z]), np.array([q.x, q.y, q.z, q.w]))


@pytest.mark.parametrize("level", [None, _LEVEL])
def test_the_frames_of_the_robot_lie_between_world_and_camera(level):
    drawn = DrawnPoses(DrawnRobot(_MOUNT, *_CHAIN[1:4], lambda: level))
    of = _moved(3)
    found = _drawn(drawn, of)
    tf = found["/viz/tf"]
    assert [(one.parent_frame_id, one.child_frame_id) for one in tf] == [*pairwise(_CHAIN)]
    assert {one.timestamp.ToNanoseconds() for one in tf} == {of.stamp_ns}
    each = [_matrix(one.translation, one.rotation) for one in tf]
    T_world_cam = pose_matrix([*of.t, *of.q])
    np.testing.assert_allclose(np.linalg.multi_dot(each), T_world_cam, atol=1e-12)
    T_world_map = np.linalg.inv(_MOUNT if level is None else level)
    np.testing.assert_allclose(each[0], T_world_map, atol=1e-12)
    np.testing.assert_allclose(each[3], _MOUNT, atol=1e-12)
    (odometry,) = found["/viz/odometry"]
    assert (odometry.frame_id, odometry.body_frame_id) == ("one/odom", "one/base_link")
    T_odom_base = _matrix(odometry.pose.position, odometry.pose.orientation)
    np.testing.assert_allclose(T_odom_base, each[2], atol=1e-12)
    by_odometry = _MOUNT @ pose_matrix(of.odometry) @ np.linalg.inv(_MOUNT)
    np.testing.assert_allclose(T_odom_base, by_odometry, atol=1e-12)


def test_without_a_robot_the_odometry_is_the_pose_of_the_log():
    of = _moved(3)
    found = _drawn(DrawnPoses(), of)
    (tf,), (odometry,) = found["/viz/tf"], found["/viz/odometry"]
    assert (tf.parent_frame_id, tf.child_frame_id) == ("world", "camera")
    assert (odometry.frame_id, odometry.body_frame_id) == ("world", "camera")
    T_world_cam = pose_matrix([*of.t, *of.q])
    for T in (
        _matrix(tf.translation, tf.rotation),
        _matrix(odometry.pose.position, odometry.pose.orientation),
    ):
        np.testing.assert_allclose(T, T_world_cam, atol=1e-12)
    covariance = np.reshape(odometry.pose_covariance, (6, 6))
    np.testing.assert_allclose(covariance, covariance_matrix(of.covariance), atol=1e-18)


def test_the_speed_is_that_of_the_odometry_and_absent_while_it_is_unknown():
    drawn, speeds = DrawnPoses(), []
    for of in (
        _moved(1),
        msgspec.structs.replace(pose(2), status="lost"),
        _moved(3),
        msgspec.structs.replace(_moved(4), odometry_stands=True),
        msgspec.structs.replace(_moved(5), covariance=[]),
    ):
        speeds += _drawn(drawn, of).get("/viz/odometry", [])
    has_speed = [(s.HasField("linear_velocity"), s.HasField("angular_velocity")) for s in speeds]
    assert has_speed == [(False, False), (True, True), (False, False), (True, True)]
    then, now = (pose_matrix(_moved(k).odometry) for k in (1, 3))
    v, w = speeds[1].linear_velocity, speeds[1].angular_velocity
    moved = se3_exp(np.array([v.x, v.y, v.z, w.x, w.y, w.z]) * 2 * 0.033333333)
    np.testing.assert_allclose(then @ moved, now, atol=1e-9)
    assert np.diag(np.reshape(speeds[1].velocity_covariance, (6, 6))).min() > 0
    unknown = [0.0] * 36
    assert speeds[2].velocity_covariance == unknown
    assert speeds[3].velocity_covariance == speeds[3].pose_covariance == unknown
