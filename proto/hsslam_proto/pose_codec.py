"""Converts poses to fields of messages and back; tracker, global BA and ROS share it."""

from collections.abc import Mapping, Sequence

import numpy as np

from hsslam_node.geometry.se3 import inverse, quaternion_from_rotation, transform
from hsslam_proto.message import Quaternion, Vector
from hsslam_proto.messages import Keyframe, Pose

_UPPER = np.triu_indices(6)


def wire_pose(T: np.ndarray) -> tuple[Vector, Quaternion]:
    """Translation and unit quaternion xyzw of a transform [4, 4], as in messages."""
    x, y, z = map(float, T[:3, 3])
    qx, qy, qz, qw = map(float, quaternion_from_rotation(T[:3, :3]))
    return (x, y, z), (qx, qy, qz, qw)


def pose_matrix(numbers: Sequence[float]) -> np.ndarray:
    """Transform [4, 4] of x, y, z, qx, qy, qz, qw."""
    return transform(np.array(numbers[:3]), np.array(numbers[3:]))


def pose_numbers(T: np.ndarray) -> list[float]:
    """x, y, z, qx, qy, qz, qw of a transform [4, 4]."""
    t, q = wire_pose(T)
    return [*t, *q]


def in_joined_keyframe(pose: Pose, of_fragment: Mapping[int, Keyframe]) -> tuple[int, np.ndarray]:
    """The keyframe of the map that a frame of a joined fragment moves with, and the frame's pose in it.

    `of_fragment`: keyframes of the map that replace those of the fragment, by `fragment_keyframe`.
    """
    number = max((n for n in of_fragment if n <= pose.keyframe), default=min(of_fragment))
    keyframe = of_fragment[number]
    T_fragment_keyframe = pose_matrix([*keyframe.t_in_fragment, *keyframe.q_in_fragment])
    return keyframe.id, inverse(T_fragment_keyframe) @ pose_matrix([*pose.t, *pose.q])


def wire_covariance(covariance: np.ndarray) -> list[float]:
    """The upper triangle of a covariance [6, 6], row by row; empty if it has a nan: unknown."""
    return [] if np.isnan(covariance).any() else covariance[_UPPER].tolist()


def covariance_matrix(upper: Sequence[float]) -> np.ndarray | None:
    """The covariance [6, 6] of its upper triangle; None if that is empty."""
    if not upper:
        return None
    out = np.zeros((6, 6))
    out[_UPPER] = upper
    return np.triu(out) + np.triu(out, 1).T
