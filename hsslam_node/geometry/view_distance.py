"""How far apart camera poses are, and how far new poses move the surfaces that cameras saw."""

import numpy as np

from hsslam_node.geometry.se3 import inverse

TURN_M_PER_RAD = 1.0  # weight of a turn beside a distance
_FAR_M = 2.0  # a turn moves surfaces at this distance


def apart(T_world_cam: np.ndarray, others: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance, m, and angle, rad, [n] each, from one pose [4, 4] to others [n, 4, 4]."""
    relative = inverse(T_world_cam) @ others
    cosine = (np.trace(relative[:, :3, :3], axis1=1, axis2=2) - 1) / 2
    return np.linalg.norm(relative[:, :3, 3], axis=1), np.arccos(np.clip(cosine, -1, 1))


def view_distance(T_world_cam: np.ndarray, others: np.ndarray) -> np.ndarray:
    """[n] m from one pose [4, 4] to others [n, 4, 4], plus 1 m for each radian between them."""
    away_m, turn_rad = apart(T_world_cam, others)
    return away_m + TURN_M_PER_RAD * turn_rad


def surface_shift_m(before: np.ndarray, after: np.ndarray) -> float:
    """The largest of `surface_shifts_m`, m; 0 without keyframes."""
    return float(surface_shifts_m(before, after).max(initial=0.0))


def surface_shifts_m(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """How far the new pose of each keyframe moves a surface 2 m away, [N] m.

    Args:
        before: T_world_cam [N, 4, 4] of the keyframes when they were observed.
        after: T_world_cam [N, 4, 4] of the same keyframes now.
    """
    step_m = np.linalg.norm(after[:, :3, 3] - before[:, :3, 3], axis=1)
    turn = np.linalg.norm(after[:, :3, :3] - before[:, :3, :3], axis=(1, 2)) / np.sqrt(2)  # rad
    return step_m + _FAR_M * turn
