"""Many rigid transforms at once; conventions as in `se3.py`: twists are (translation m, rotation rad)."""

import numpy as np

_SMALL_ANGLE_RAD = 1e-4  # below it series are more exact than quotients


def exp_batch(xi: np.ndarray) -> np.ndarray:
    """Twists [n, 6] to transforms [n, 4, 4]."""
    W = _skew(xi[:, 3:])
    theta = np.linalg.norm(xi[:, 3:], axis=1)[:, None, None]
    safe = np.maximum(theta, _SMALL_ANGLE_RAD)
    small = theta < _SMALL_ANGLE_RAD
    a = np.where(small, 1 - theta**2 / 6, np.sin(safe) / safe)
    b = np.where(small, 0.5 - theta**2 / 24, (1 - np.cos(safe)) / safe**2)
    c = np.where(small, 1 / 6 - theta**2 / 120, (safe - np.sin(safe)) / safe**3)
    WW = W @ W
    T = np.tile(np.eye(4), (len(xi), 1, 1))
    T[:, :3, :3] += a * W + b * WW
    T[:, :3, 3] = ((np.eye(3) + b * W + c * WW) @ xi[:, :3, None])[..., 0]
    return T


def log_batch(T: np.ndarray) -> np.ndarray:
    """Transforms [n, 4, 4] to twists [n, 6], rotation angles in [0, pi); exact up to 3 rad."""
    R = T[:, :3, :3]
    axis = 0.5 * np.stack(
        [R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1
    )  # [n, 3], of length sin(theta)
    sine = np.linalg.norm(axis, axis=1)
    theta = np.arctan2(sine, 0.5 * (np.trace(R, axis1=1, axis2=2) - 1))
    small = theta < _SMALL_ANGLE_RAD
    factor = np.where(small, 1 + theta**2 / 6, theta / np.maximum(sine, 1e-12))
    omega = factor[:, None] * axis
    half = np.maximum(theta, _SMALL_ANGLE_RAD) / 2
    d = np.where(small, 1 / 12 + theta**2 / 720, (1 - half / np.tan(half)) / (2 * half) ** 2)
    W = _skew(omega)
    V_inv = np.eye(3) - 0.5 * W + d[:, None, None] * (W @ W)
    return np.concatenate([(V_inv @ T[:, :3, 3, None])[..., 0], omega], axis=1)


def inverse_batch(T: np.ndarray) -> np.ndarray:
    """Inverses of transforms [n, 4, 4]."""
    out = np.tile(np.eye(4), (len(T), 1, 1))
    R_t = np.swapaxes(T[:, :3, :3], 1, 2)
    out[:, :3, :3] = R_t
    out[:, :3, 3] = -(R_t @ T[:, :3, 3, None])[..., 0]
    return out


def adjoint_batch(T: np.ndarray) -> np.ndarray:
    """[n, 6, 6] with T exp(x) = exp(adjoint x) T."""
    out = np.zeros((len(T), 6, 6))
    R = T[:, :3, :3]
    out[:, :3, :3] = R
    out[:, 3:, 3:] = R
    out[:, :3, 3:] = _skew(T[:, :3, 3]) @ R
    return out


def log_jacobian_batch(xi: np.ndarray) -> np.ndarray:
    """[n, 6, 6] with log(exp(xi) exp(x)) = xi + J x to first order in x; to the fifth order in xi."""
    ad = np.zeros((len(xi), 6, 6))
    W = _skew(xi[:, 3:])
    ad[:, :3, :3] = W
    ad[:, 3:, 3:] = W
    ad[:, :3, 3:] = _skew(xi[:, :3])
    square = ad @ ad
    return np.eye(6) + ad / 2 + square / 12 - square @ square / 720


def _skew(v: np.ndarray) -> np.ndarray:
    """Cross-product matrices [n, 3, 3] of vectors [n, 3]."""
    W = np.zeros((len(v), 3, 3))
    W[:, 0, 1], W[:, 0, 2], W[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return W - np.swapaxes(W, 1, 2)


def quaternions_from_rotations(R: np.ndarray) -> np.ndarray:
    """Unit quaternions [N, 4] xyzw of rotation matrices [N, 3, 3] (Shepperd's method)."""
    diagonal = np.diagonal(R, axis1=1, axis2=2)  # [N, 3]
    trace = diagonal.sum(axis=1)
    largest = np.argmax(np.concatenate([diagonal, trace[:, None]], axis=1), axis=1)  # [N]
    q = np.empty((len(R), 4))
    w = largest == 3
    q[w, 0] = R[w, 2, 1] - R[w, 1, 2]
    q[w, 1] = R[w, 0, 2] - R[w, 2, 0]
    q[w, 2] = R[w, 1, 0] - R[w, 0, 1]
    q[w, 3] = 1.0 + trace[w]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        at = largest == i
        q[at, i] = 1.0 + 2.0 * R[at, i, i] - trace[at]
        q[at, j] = R[at, j, i] + R[at, i, j]
        q[at, k] = R[at, k, i] + R[at, i, k]
        q[at, 3] = R[at, k, j] - R[at, j, k]
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def transforms(translations: np.ndarray, quaternions_xyzw: np.ndarray) -> np.ndarray:
    """Rigid transforms [N, 4, 4] of translations [N, 3] and quaternions [N, 4] (normalised here)."""
    q = quaternions_xyzw / np.linalg.norm(quaternions_xyzw, axis=1, keepdims=True)
    cross = _skew(q[:, :3])
    T = np.zeros((len(q), 4, 4))
    T[:, :3, :3] = np.eye(3) + 2 * (q[:, 3, None, None] * cross + cross @ cross)
    T[:, :3, 3] = translations
    T[:, 3, 3] = 1
    return T
