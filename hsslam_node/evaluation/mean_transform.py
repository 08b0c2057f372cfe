"""What lies between two worlds in which the same poses are known."""

import numpy as np


def mean_transform(T_estimate: np.ndarray, T_truth: np.ndarray) -> np.ndarray:
    """T_truth_estimate [4, 4] by the mean of rotations, then of positions, of poses [n, 4, 4].

    The positions alone tell little of the rotation about their longest axis.
    """
    U, _, Vt = np.linalg.svd(np.einsum("nij,nkj->ik", T_truth[:, :3, :3], T_estimate[:, :3, :3]))
    T = np.eye(4)
    T[:3, :3] = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    T[:3, 3] = (T_truth[:, :3, 3] - T_estimate[:, :3, 3] @ T[:3, :3].T).mean(axis=0)
    return T
