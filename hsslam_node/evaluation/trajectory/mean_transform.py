"""The mean transform between two sets of poses; a file of its own as two scores share it."""

import numpy as np
from scipy.spatial.transform import Rotation


def mean_transform(T_estimate: np.ndarray, T_truth: np.ndarray) -> np.ndarray:
    """T_truth_estimate [4, 4] by the mean of rotations, then of positions, of poses [n, 4, 4]; NaN if n = 0.

    Positions alone would hardly fix the rotation about their longest axis.
    """
    if len(T_truth) == 0:
        return np.full((4, 4), np.nan)
    turns = Rotation.from_matrix(T_truth[:, :3, :3] @ T_estimate[:, :3, :3].mT)
    T = np.eye(4)
    T[:3, :3] = turns.mean().as_matrix()
    T[:3, 3] = (T_truth[:, :3, 3] - T_estimate[:, :3, 3] @ T[:3, :3].T).mean(axis=0)
    return T
