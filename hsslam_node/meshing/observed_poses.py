"""Whether what keyframes were seen to show still lies where it was observed."""

import numpy as np

_FAR_M = 2.0  # a turn moves surfaces at this distance


def surface_shift_m(before: np.ndarray, after: np.ndarray) -> float:
    """The most that a surface 2 m away has been moved by new poses of its keyframes, m.

    Args:
        before, after: T_world_cam [N, 4, 4] each.
    """
    if len(before) == 0:
        return 0.0
    step_m = np.linalg.norm(after[:, :3, 3] - before[:, :3, 3], axis=1)
    turn = np.linalg.norm(after[:, :3, :3] - before[:, :3, :3], axis=(1, 2)) / np.sqrt(2)  # rad
    return float((step_m + _FAR_M * turn).max())
