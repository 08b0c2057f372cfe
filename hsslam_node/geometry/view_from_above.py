"""A view of a whole scene from above; alone, as both pictures of a mesh share it."""

import numpy as np

_CANCELLED = 0.3  # a mean of unit vectors that is shorter has no direction


def mean_up(T_world_cam: np.ndarray) -> np.ndarray:
    """The direction against gravity [3] for a hand-held camera: the mean image up of poses [N, 4, 4].

    If these cancel out, the camera looks straight down or up and turns; it is taken to look down, and up is
    against its mean viewing direction.
    """
    up, ahead = -T_world_cam[:, :3, 1].mean(axis=0), mean_ahead(T_world_cam)
    if np.linalg.norm(up) < _CANCELLED < np.linalg.norm(ahead):
        up = -ahead
    length = np.linalg.norm(up)
    return up / length if length > 0 else -T_world_cam[0, :3, 1]


def mean_ahead(T_world_cam: np.ndarray) -> np.ndarray:
    """The mean viewing direction [3] of camera poses [N, 4, 4]; not normalised."""
    ahead: np.ndarray = T_world_cam[:, :3, 2].mean(axis=0)
    return ahead


def looking_down(up: np.ndarray, ahead: np.ndarray, elevation_rad: float) -> np.ndarray:
    """R_world_cam [3, 3] of a view from an elevation above the horizon; x right, y down, z forward.

    Args:
        up: against gravity, [3], unit length.
        ahead: [3]; the view looks along its horizontal part; upright or 0: any direction.
    """
    side = np.cross(ahead, up)
    if np.linalg.norm(side) < 1e-3:
        side = np.cross(up, [1.0, 0, 0] if abs(up[0]) < 0.9 else [0, 1.0, 0])
    side /= np.linalg.norm(side)
    away = np.cos(elevation_rad) * np.cross(side, up) + np.sin(elevation_rad) * up
    return np.stack([side, np.cross(-away, side), -away], axis=1)
