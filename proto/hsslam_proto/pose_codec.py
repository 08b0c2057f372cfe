"""Poses in the form of the wire; a file of its own as tracker and global BA share it."""

import numpy as np

from hsslam_node.geometry.se3 import quaternion_from_rotation
from hsslam_proto.messages import Quaternion, Vector


def wire_pose(T: np.ndarray) -> tuple[Vector, Quaternion]:
    """Translation and unit quaternion xyzw of a transform [4, 4], as the wire has them."""
    x, y, z = map(float, T[:3, 3])
    qx, qy, qz, qw = map(float, quaternion_from_rotation(T[:3, :3]))
    return (x, y, z), (qx, qy, qz, qw)
