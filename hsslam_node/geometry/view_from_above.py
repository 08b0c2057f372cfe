"""A view of a whole scene from above; alone, as both pictures of a mesh share no more than this."""

import numpy as np


def mean_up(T_world_cam: np.ndarray) -> np.ndarray:
    """The direction against gravity [3]: the mean of the image's up over poses [N, 4, 4], for a hand-held
    camera."""
    up = -T_world_cam[:, :3, 1].mean(axis=0)
    return up / np.linalg.norm(up)


def mean_ahead(T_world_cam: np.ndarray) -> np.ndarray:
    """The direction [3] that cameras at poses [N, 4, 4] look in, in the mean; of any length."""
    ahead: np.ndarray = T_world_cam[:, :3, 2].mean(axis=0)
    return ahead


def looking_down(up: np.ndarray, ahead: np.ndarray, elevation_rad: float) -> np.ndarray:
    """R_world_cam [3, 3] of a view from an elevation above the horizon; x right, y down, z forward.

    Args:
        up: against gravity, [3], unit length.
        ahead: [3], which the view looks along as far as it is horizontal; upright or 0: any direction.
    """
    side = np.cross(ahead, up)
    if np.linalg.norm(side) < 1e-3:
        side = np.cross(up, [1.0, 0, 0] if abs(up[0]) < 0.9 else [0, 1.0, 0])
    side /= np.linalg.norm(side)
    away = np.cos(elevation_rad) * np.cross(side, up) + np.sin(elevation_rad) * up
    return np.stack([side, np.cross(-away, side), -away], axis=1)
