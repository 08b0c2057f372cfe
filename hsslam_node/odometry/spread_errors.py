"""Poses by odometry alone, once the camera has seen again where it is: its error is spread over them."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from hsslam_node.geometry.se3 import inverse, skew, so3_exp, so3_log
from hsslam_node.odometry.noise import growth

_STILL = 1e-12  # m^2, rad^2: the error of a step without motion


def spread_errors(
    T_world_cam: np.ndarray, T_odom_cam: np.ndarray, is_dead_reckoned: np.ndarray
) -> np.ndarray:
    """The poses [N, 4, 4] with each stretch [N] bool of dead-reckoned ones fitted in between its neighbours.

    Each step of a stretch takes its share of what odometry was off at the end, by how much it moved: the
    most likely errors of a random walk. A stretch without a frame before or after it stays as it is.

    Args:
        T_odom_cam: [N, 4, 4] a path of the same frames that follows odometry through such a stretch, from
            the frame before to the frame after it.
    """
    out = T_world_cam
    for before, after in _stretches(is_dead_reckoned):
        rows = slice(before, after + 1)
        if out is T_world_cam:
            out = T_world_cam.copy()
        path = out[before] @ inverse(T_odom_cam[before]) @ T_odom_cam[rows]
        out[before + 1 : after] = _bent(path, T_world_cam[after])[1:-1]
    return out


def _stretches(is_dead_reckoned: np.ndarray) -> Iterator[tuple[int, int]]:
    """The frames before and after each."""
    edges = np.diff(is_dead_reckoned.astype(np.int8))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) + 1
    if is_dead_reckoned[:1].any():
        ends = ends[1:]
    yield from zip(starts.tolist(), ends.tolist(), strict=False)


def _bent(path: np.ndarray, T_end: np.ndarray) -> np.ndarray:
    """The path [n, 4, 4], its first pose as it is and its last one moved to T_end [4, 4]."""
    centres = path[:, :3, 3]
    off = np.concatenate([T_end[:3, 3] - centres[-1], so3_log(T_end[:3, :3] @ path[-1, :3, :3].T)])
    steps = [growth(a, b, 1.0) + _STILL * np.eye(6) for a, b in pairwise(path)]
    to_end = [_effect(centres[-1] - centre) for centre in centres[1:]]
    total = sum((J @ D @ J.T for J, D in zip(to_end, steps, strict=True)), np.zeros((6, 6)))
    share = np.linalg.solve(total, off)
    out, moved = path.copy(), np.zeros(6)
    for k, (J, D) in enumerate(zip(to_end, steps, strict=True), 1):
        moved = _effect(centres[k] - centres[k - 1]) @ moved + D @ J.T @ share
        out[k, :3, :3] = so3_exp(moved[3:]) @ path[k, :3, :3]
        out[k, :3, 3] += moved[:3]
    return out


def _effect(lever_m: np.ndarray) -> np.ndarray:
    """[6, 6] of a small motion (m, rad) on what is `lever_m` [3] from its centre."""
    J = np.eye(6)
    J[:3, 3:] = -skew(lever_m)
    return J
