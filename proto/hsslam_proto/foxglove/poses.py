"""Foxglove messages of poses: transforms, the pose of the camera, odometry."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Odometry_pb2 import Odometry
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame

from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.geometry.se3 import inverse
from hsslam_proto.foxglove.visualisation import CAMERA, WORLD, VizMessage, viz
from hsslam_proto.message import Quaternion, Vector
from hsslam_proto.messages import Pose
from hsslam_proto.pose_codec import wire_pose
from hsslam_proto.robot_motion import RobotPath

_CAMERA_ALONE = RobotFrames(np.eye(4))
_UNKNOWN = np.zeros((6, 6))  # in Foxglove's schema


@dataclass(frozen=True)
class DrawnRobot:
    """A robot with its camera on it, and the names of its frames, with their prefix.

    `level`: returns the transform [4, 4] from the world to `map`; None: this robot began the world.
    """

    T_base_cam: np.ndarray
    map: str
    odom: str
    base: str
    level: Callable[[], np.ndarray | None]


class DrawnPoses:
    """Draws poses in their order; lost poses are not drawn.

    Without a robot `camera` is in `world`, and so is the odometry. With one the chain is `world` -> `map` ->
    `odom` -> `base_link` -> `camera`, and the odometry is `base_link` in `odom`, as in ROS.
    `by_wall_clock`: see `RobotPath`.
    """

    def __init__(self, robot: DrawnRobot | None = None, *, by_wall_clock: bool = False) -> None:
        self._robot = robot
        self._path = RobotPath(by_wall_clock=by_wall_clock)

    def of(self, pose: Pose) -> list[VizMessage]:
        """The /viz messages of a pose."""
        if pose.status == "lost":
            return []
        robot = self._robot
        frames = RobotFrames(robot.T_base_cam, robot.level()) if robot else _CAMERA_ALONE
        motion = self._path.next(pose, frames)
        assert motion.T_map_base is not None and motion.T_map_odom is not None  # not of a fragment
        if robot is None:
            chain = [(WORLD, CAMERA, motion.T_map_base)]
            body, covariance = chain[0], motion.covariance_in_map
        else:
            body, covariance = (
                (robot.odom, robot.base, motion.T_odom_base),
                motion.covariance_in_odom,
            )
            chain = [
                (WORLD, robot.map, inverse(frames.T_map_world)),
                (robot.map, robot.odom, motion.T_map_odom),
                body,
                (robot.base, CAMERA, robot.T_base_cam),
            ]
        parent, child, T = body
        odometry = Odometry(
            frame_id=parent,
            body_frame_id=child,
            pose_covariance=_row_by_row(covariance),
            velocity_covariance=_row_by_row(motion.twist_covariance),
        )
        odometry.timestamp.FromNanoseconds(pose.stamp_ns)
        _set(odometry.pose.position, odometry.pose.orientation, *wire_pose(T))
        if motion.twist is not None:
            linear, angular = odometry.linear_velocity, odometry.angular_velocity
            linear.x, linear.y, linear.z, angular.x, angular.y, angular.z = motion.twist.tolist()
        return [
            *(viz("/viz/tf", _transform(pose.stamp_ns, *each)) for each in chain),
            viz("/viz/pose", _pose(pose)),
            viz("/viz/odometry", odometry),
        ]


def _transform(stamp_ns: int, parent: str, child: str, T: np.ndarray) -> FrameTransform:
    transform = FrameTransform(parent_frame_id=parent, child_frame_id=child)
    transform.timestamp.FromNanoseconds(stamp_ns)
    _set(transform.translation, transform.rotation, *wire_pose(T))
    return transform


def _pose(pose: Pose) -> PoseInFrame:
    out = PoseInFrame(frame_id=WORLD)
    out.timestamp.FromNanoseconds(pose.stamp_ns)
    _set(out.pose.position, out.pose.orientation, pose.t, pose.q)
    return out


def _row_by_row(covariance: np.ndarray | None) -> list[float]:
    return (_UNKNOWN if covariance is None else covariance).ravel().tolist()


def _set(position: Any, rotation: Any, t: Vector, q: Quaternion) -> None:
    position.x, position.y, position.z = t
    rotation.x, rotation.y, rotation.z, rotation.w = q
