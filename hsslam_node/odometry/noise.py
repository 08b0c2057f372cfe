"""How sure odometry is that does not say so; a file of its own as sources and simulation share it."""

import numpy as np

from hsslam_node.geometry.pose_covariance import turned
from hsslam_node.geometry.se3 import inverse, se3_log

USUAL_NOISE = 0.02
_TURN_RAD_PER_M = 0.5  # a way of 1 m turns as unsurely as a turn of so much
_JUMP = np.diag([1.0] * 6)  # m^2, rad^2: of this motion nothing is known


def growth(T_odom_a: np.ndarray, T_odom_b: np.ndarray, noise: float) -> np.ndarray:
    """Covariance [6, 6] of the motion from a to b [4, 4], axes of odom, rotation about b's centre.

    A random walk: `noise` is the standard deviation after 1 m (in m) and after 1 rad (in rad). The sum
    over the steps of a way does not depend on how many they are.
    """
    twist = se3_log(inverse(T_odom_a) @ T_odom_b)
    way_m, turn_rad = np.linalg.norm(twist[:3]), np.linalg.norm(twist[3:])
    variances = [way_m] * 3 + [turn_rad + _TURN_RAD_PER_M * way_m] * 3
    return turned(noise**2 * np.diag(variances), T_odom_b[:3, :3])


def of_jump() -> np.ndarray:
    """[6, 6] of a motion that no robot makes: odometry began anew."""
    return _JUMP.copy()
