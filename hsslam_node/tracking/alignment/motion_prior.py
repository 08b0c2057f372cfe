"""The motion prior: in directions that a frame does not constrain, its pose stays near the prediction."""

import numpy as np

from hsslam_node.geometry.se3 import inverse, so3_log

_LEVER_M = 2.0  # a rotation counts as the motion of a point at this distance


def with_motion_prior(
    H: np.ndarray,
    b: np.ndarray,
    T_world_cam: np.ndarray,
    prediction: np.ndarray,
    weak_m: float,
    doubt: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Normal equations H [8, 8], b [8] whose weak directions are held at the predicted pose [4, 4].

    Along each eigenvector of the pose's information (gain and bias eliminated) the prior weighs
    w^2 / information with w = 1 / weak_m^2: next to nothing if the data constrain the pose much better
    than weak_m, nearly all if they constrain it much worse, as along the axis of a bare corridor.

    doubt: covariance [6, 6] of a prediction by odometry, as of `moved_about_camera`; its inverse limits the
    weight in each direction. None: a prediction by constant velocity.
    """
    scale = np.array([1.0, 1.0, 1.0, 1 / _LEVER_M, 1 / _LEVER_M, 1 / _LEVER_M])
    pose = pose_information(H)
    information, direction = np.linalg.eigh(scale[:, None] * pose * scale)
    least = 1.0 / weak_m**2
    strength = least**2 / np.maximum(information, 1e-3 * least)  # [6]
    if doubt is not None:
        scaled = doubt / scale[:, None] / scale
        strength = np.minimum(strength, 1 / np.einsum("ji,jk,ki->i", direction, scaled, direction))
    unscaled = direction / scale[:, None]
    P = (unscaled * strength) @ unscaled.T
    H, b = H.copy(), b.copy()
    H[:6, :6] += P
    b[:6] += P @ _twist_between(prediction, T_world_cam)
    return H, b


def pose_information(H: np.ndarray) -> np.ndarray:
    """[6, 6] of the pose alone from [8, 8], gain and bias eliminated; the Schur complement."""
    return H[:6, :6] - H[:6, 6:] @ np.linalg.solve(H[6:, 6:], H[6:, :6])


def _twist_between(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Twist [6] (m, rad; world axes, rotation about the camera) from one pose to the other."""
    return np.concatenate(
        [end[:3, 3] - start[:3, 3], so3_log(end[:3, :3] @ inverse(start)[:3, :3])]
    )
