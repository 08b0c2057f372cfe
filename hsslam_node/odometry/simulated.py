"""Simulated odometry of built-in scenes; apart from real odometry, as it uses true poses."""

from itertools import pairwise

import numpy as np

from hsslam_node.geometry.se3 import inverse, se3_exp, se3_log
from hsslam_node.odometry.noise import growth
from hsslam_node.odometry.reading import OdometryReading


def simulated_odometry(T_true: np.ndarray, noise: float, seed: int) -> list[OdometryReading]:
    """Readings of odometry with an error of `noise` (0.01: 1 %) along true camera poses [N, 4, 4].

    Each of the six components of motion has a constant error of scale with this standard deviation. Each
    step also has an error of this share of its length and its angle, in a random direction. The path begins
    at a random pose.
    """
    rng = np.random.default_rng((seed, 8))
    scale = 1.0 + noise * rng.standard_normal(6)
    T = se3_exp(rng.uniform(-1.0, 1.0, 6))
    readings, covariance = [OdometryReading.at(T, np.zeros((6, 6)))], np.zeros((6, 6))
    for before, after in pairwise(T_true):
        twist = se3_log(inverse(before) @ after)
        size = np.repeat([np.linalg.norm(twist[:3]), np.linalg.norm(twist[3:])], 3)
        twist = scale * twist + noise * size * rng.standard_normal(6) / np.sqrt(3)
        T_next = T @ se3_exp(twist)
        covariance = covariance + growth(T, T_next, noise)
        readings.append(OdometryReading.at(T_next, covariance))
        T = T_next
    return readings
