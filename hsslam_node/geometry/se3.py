"""Rigid transforms as 4x4 float64 matrices; twists (translation, rotation); quaternions xyzw."""

import math

import numpy as np

FARTHEST_M = 1e6  # of a pose from the origin
_SMALL_ANGLE_RAD = 1e-6
_ROUNDED = 1e-3  # largest error of the products of a rotation's columns


def se3_exp(xi: np.ndarray) -> np.ndarray:
    """Exponential map of SE(3): twist [6] (m, rad) to transform [4, 4]; smooth at zero."""
    rho, omega = np.asarray(xi[:3], np.float64), np.asarray(xi[3:], np.float64)
    _, b, c = _coefficients(omega)
    W = skew(omega)
    T = np.eye(4)
    T[:3, :3] = so3_exp(omega)
    T[:3, 3] = (np.eye(3) + b * W + c * W @ W) @ rho
    return T


def se3_log(T: np.ndarray) -> np.ndarray:
    """Logarithm of SE(3): transform [4, 4] to twist [6] (m, rad), rotation angle in [0, pi]."""
    omega = so3_log(T[:3, :3])
    theta = float(np.linalg.norm(omega))
    W = skew(omega)
    if theta < _SMALL_ANGLE_RAD:
        d = 1 / 12 + theta**2 / 720
    elif np.sin(theta) > 1e-9:
        d = 1 / theta**2 - (1 + np.cos(theta)) / (2 * theta * np.sin(theta))
    else:
        d = 1 / theta**2
    V_inv = np.eye(3) - 0.5 * W + d * W @ W
    return np.concatenate([V_inv @ T[:3, 3], omega])


def so3_exp(omega: np.ndarray) -> np.ndarray:
    """Rotation matrix [3, 3] of a rotation vector [3] (rad); Rodrigues, smooth at zero."""
    a, b, _ = _coefficients(omega)
    W = skew(omega)
    return np.eye(3) + (a * W + b * W @ W)


def so3_log(R: np.ndarray) -> np.ndarray:
    """Rotation vector [3] (rad) of a rotation matrix [3, 3]."""
    q = quaternion_from_rotation(R)
    if q[3] < 0:
        q = -q
    sine = float(np.linalg.norm(q[:3]))
    if sine < _SMALL_ANGLE_RAD:
        return 2.0 * q[:3]
    return q[:3] * (2.0 * np.arctan2(sine, q[3]) / sine)


def transformed(T: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points [..., 3] after a rigid transform [4, 4]."""
    return points @ T[:3, :3].T + T[:3, 3]


def inverse(T: np.ndarray) -> np.ndarray:
    """Inverse of a rigid transform [4, 4]."""
    out = np.eye(4)
    out[:3, :3] = T[:3, :3].T
    out[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return out


def moved_about_camera(T_world_cam: np.ndarray, step: np.ndarray) -> np.ndarray:
    """The pose moved by a twist [6] (m, rad) in world axes, rotation about the camera's centre."""
    out = T_world_cam.copy()
    out[:3, :3] = so3_exp(step[3:]) @ T_world_cam[:3, :3]
    out[:3, 3] += step[:3]
    return out


def skew(v: np.ndarray) -> np.ndarray:
    """Cross-product matrix [3, 3] of a vector [3]."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def quaternion_from_rotation(R: np.ndarray) -> np.ndarray:
    """Unit quaternion [4] xyzw of a rotation matrix [3, 3] (Shepperd's method)."""
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    candidates = np.array([R[0, 0], R[1, 1], R[2, 2], trace])
    k = int(np.argmax(candidates))
    q = np.empty(4)
    if k == 3:
        q[:] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], 1.0 + trace
    else:
        i, j, m = k, (k + 1) % 3, (k + 2) % 3
        q[i] = 1.0 + 2.0 * R[i, i] - trace
        q[j] = R[j, i] + R[i, j]
        q[m] = R[m, i] + R[i, m]
        q[3] = R[m, j] - R[j, m]
    return q / np.linalg.norm(q)


def rotation_from_quaternion(q: np.ndarray) -> np.ndarray:
    """Rotation matrix [3, 3] of a quaternion [4] xyzw (normalised here)."""
    x, y, z, w = np.asarray(q, np.float64) / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def transform(translation: np.ndarray, quaternion_xyzw: np.ndarray) -> np.ndarray:
    """Transform [4, 4] of a translation [3] m and a quaternion [4] xyzw."""
    T = np.eye(4)
    T[:3, :3] = rotation_from_quaternion(quaternion_xyzw)
    T[:3, 3] = translation
    return T


def _coefficients(omega: np.ndarray) -> tuple[float, float, float]:
    """sin(t) / t, (1 - cos(t)) / t^2 and (1 - sin(t) / t) / t^2 at the angle t of a rotation vector."""
    theta = float(np.linalg.norm(omega))
    if theta < _SMALL_ANGLE_RAD:
        return 1.0 - theta**2 / 6, 0.5 - theta**2 / 24, 1 / 6 - theta**2 / 120
    a = math.sin(theta) / theta
    return a, (1 - math.cos(theta)) / theta**2, (1 - a) / theta**2


def are_rigid(T: np.ndarray) -> bool:
    """Whether transforms [N, 4, 4] are finite, at most 1000 km long, and neither scale nor mirror."""
    R, t = T[:, :3, :3], T[:, :3, 3]
    if not ((np.abs(R) <= 2.0).all() and (np.abs(t) <= FARTHEST_M).all()):  # so none is nan
        return False
    is_turned = (np.abs(R.transpose(0, 2, 1) @ R - np.eye(3)) <= _ROUNDED).all()
    return bool(is_turned and (np.linalg.det(R) > 0).all() and (T[:, 3] == [0, 0, 0, 1]).all())
