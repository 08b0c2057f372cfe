"""Trajectories for tests."""

import numpy as np

from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.geometry.trajectory import Trajectory


def walk(n: int = 90, seed: int = 0, rate_hz: float = 30.0) -> Trajectory:
    """A smooth random walk of a camera, about 1.5 cm and 1 degree a frame."""
    rng = np.random.default_rng(seed)
    twist, poses = np.zeros(6), [se3_exp(rng.normal(size=6))]
    for _ in range(n - 1):
        twist = 0.9 * twist + rng.normal(0, 1, 6) * ([0.004] * 3 + [0.007] * 3)
        poses.append(poses[-1] @ se3_exp(twist))
    stamps_ns = 1_700_000_000_000_000_000 + np.round(np.arange(n) * 1e9 / rate_hz).astype(np.int64)
    return Trajectory(stamps_ns, np.array(poses))


def shaken(trajectory: Trajectory, seed: int = 1, amount: float = 0.01) -> Trajectory:
    """Each pose moved by noise with these deviations, in metres and radians."""
    rng = np.random.default_rng(seed)
    noise = np.array([se3_exp(rng.normal(0, amount, 6)) for _ in trajectory.stamps_ns])
    return Trajectory(trajectory.stamps_ns, trajectory.T_world_cam @ noise)
