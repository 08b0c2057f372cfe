"""How far apart two cameras stand and look; apart, as mapping, tracking and places ask it."""

import numpy as np

from hsslam_node.geometry.se3 import inverse

TURN_M_PER_RAD = 1.0  # what a turn counts beside a distance


def apart(T_world_cam: np.ndarray, others: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance, m, and angle, rad, [n] each, from one pose [4, 4] to others [n, 4, 4]."""
    relative = inverse(T_world_cam) @ others
    cosine = (np.trace(relative[:, :3, :3], axis1=1, axis2=2) - 1) / 2
    return np.linalg.norm(relative[:, :3, 3], axis=1), np.arccos(np.clip(cosine, -1, 1))


def view_distance(T_world_cam: np.ndarray, others: np.ndarray) -> np.ndarray:
    """[n] m from one pose [4, 4] to others [n, 4, 4], with 1 m for each radian between them."""
    away_m, turn_rad = apart(T_world_cam, others)
    return away_m + TURN_M_PER_RAD * turn_rad
