"""How far two views are apart, and which distances count as far or wrong."""

import numpy as np

from hsslam_node.geometry.se3 import so3_log

_WRONG_M, _WRONG_DEG = 0.1, 5.0
_FAR_M, _FAR_DEG = 0.75, 40.0


def view_difference(T_world_a: np.ndarray, T_world_b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances [n] m and angles [n] degrees between poses [n, 4, 4]."""
    step = np.linalg.inv(T_world_a) @ T_world_b
    turn_rad = [np.linalg.norm(so3_log(T[:3, :3])) for T in step]
    return np.linalg.norm(step[:, :3, 3], axis=1), np.rad2deg(turn_rad)


def is_wrong(distance_m: np.ndarray, angle_deg: np.ndarray) -> np.ndarray:
    """[n] bool: whether a pose is more than 10 cm or 5 degrees off the truth."""
    return (distance_m > _WRONG_M) | (angle_deg > _WRONG_DEG)


def is_far(T_world_a: np.ndarray, T_world_b: np.ndarray) -> bool:
    """Whether two views [4, 4] are more than 75 cm or 40 degrees apart."""
    distance_m, angle_deg = view_difference(T_world_a[None], T_world_b[None])
    return bool(distance_m[0] > _FAR_M or angle_deg[0] > _FAR_DEG)
