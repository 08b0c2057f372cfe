"""Poses of a camera that is held level."""

import numpy as np


def upright_poses(
    position: np.ndarray, yaw: np.ndarray, pitch: np.ndarray, roll: np.ndarray
) -> np.ndarray:
    """Camera-to-world poses [N, 4, 4] from positions [N, 3] and heading about z, look-down, roll, rad."""
    forward = np.stack(
        [np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)], axis=-1
    )
    level = np.stack([np.sin(yaw), -np.cos(yaw), np.zeros_like(yaw)], axis=-1)
    down = np.cross(forward, level)
    c, s = np.cos(roll)[:, None], np.sin(roll)[:, None]
    T = np.zeros((len(yaw), 4, 4))
    T[:, :3, 0] = c * level + s * down
    T[:, :3, 1] = c * down - s * level
    T[:, :3, 2] = forward
    T[:, :3, 3] = position
    T[:, 3, 3] = 1.0
    return T
