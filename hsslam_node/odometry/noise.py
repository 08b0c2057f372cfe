"""Noise of odometry that reports no covariance; a file of its own because options and simulation share it."""

import numpy as np

from hsslam_node.geometry.pose_covariance import carried, turned
from hsslam_node.geometry.se3 import inverse, se3_log

USUAL_NOISE = 0.02
_TURN_RAD_PER_M = 0.5  # 1 m of path adds the variance of a rotation by this angle
_JUMP = np.diag([1.0] * 6)  # m^2, rad^2: an unknown motion


def growth(T_odom_a: np.ndarray, T_odom_b: np.ndarray, noise: float) -> np.ndarray:
    """Covariance [6, 6] of the motion from a to b [4, 4], axes of odom, rotation about b's centre.

    A random walk: `noise` is the standard deviation after 1 m (in m) and after 1 rad (in rad). The sum
    over the steps of a path does not depend on their number.
    """
    twist = se3_log(inverse(T_odom_a) @ T_odom_b)
    way_m, turn_rad = np.linalg.norm(twist[:3]), np.linalg.norm(twist[3:])
    variances = [way_m] * 3 + [turn_rad + _TURN_RAD_PER_M * way_m] * 3
    return turned(noise**2 * np.diag(variances), T_odom_b[:3, :3])


def increase(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Growth [6, 6] of a covariance; 0 along axes where it shrinks, and where it is not finite.

    A source that corrects its poses by other sensors makes poses surer, but not the motion between them.
    """
    grown = np.nan_to_num(after - before, nan=0.0, posinf=0.0, neginf=0.0)
    value, direction = np.linalg.eigh((grown + grown.T) / 2)
    return (direction * np.maximum(value, 0.0)) @ direction.T


def increase_of_motion(before: np.ndarray, after: np.ndarray, step_m: np.ndarray) -> np.ndarray:
    """As `increase`, without what the heading before the motion adds to the position, [6, 6].

    The covariance of a filter (EKF) has this part: an error of the heading moves the end of the motion
    `step_m` [3] (axes of odom) sideways in odom, but is no error of the motion. Covariances of other sources
    do not have it, so the smaller growth counts.
    """
    grown = increase(before, after)
    of_motion = increase(carried(np.nan_to_num(before), step_m), after)
    return of_motion if np.trace(of_motion) < np.trace(grown) else grown


def of_jump() -> np.ndarray:
    """Covariance [6, 6] of a jump of odometry, as after a restart of its driver."""
    return _JUMP.copy()
