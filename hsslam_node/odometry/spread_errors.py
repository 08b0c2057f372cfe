"""Corrects dead-reckoned poses: spreads the error at the end of a gap over the gap."""

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np

from hsslam_node.geometry.pose_covariance import lever
from hsslam_node.geometry.se3 import inverse, se3_log, so3_exp, so3_log
from hsslam_node.odometry.noise import growth

_WALK = 0.2  # standard deviation of the random walk after 1 m and 1 rad over that of scale
_STILL = 1e-12  # m^2, rad^2: variance of a step without motion
Walk = Callable[
    [np.ndarray, np.ndarray], np.ndarray
]  # T_a, T_b [4, 4]: covariance of b [6, 6], world axes


def usual_walk(T_a: np.ndarray, T_b: np.ndarray) -> np.ndarray:
    """The random walk of a step from a to b [4, 4], beside an error of scale with deviation 1, [6, 6]."""
    return growth(T_a, T_b, _WALK)


def spread_errors(
    T_world_cam: np.ndarray,
    T_odom_cam: np.ndarray,
    is_dead_reckoned: np.ndarray,
    is_unknown: np.ndarray,
    walk: Walk = usual_walk,
) -> np.ndarray:
    """The poses [N, 4, 4] with each stretch of dead-reckoned ones ([N] bool) fitted between its neighbours.

    The most likely errors of odometry explain the difference at the end: an error of scale in each of the
    six components of its motion, and a random walk. A stretch stays as it is if there is no frame before or
    after it, or if a motion in it is unknown.

    Args:
        T_odom_cam: [N, 4, 4] a path of the same frames that follows odometry through each stretch, from
            the frame before it to the frame after it.
        is_unknown: [N] bool, whether the motion to a frame is unknown in `T_odom_cam`.
        walk: covariance of the random walk of a step, if that of the error of scale is 1.
    """
    out = T_world_cam
    for before, after in _stretches(is_dead_reckoned):
        rows = slice(before, after + 1)
        if is_unknown[rows][1:].any():
            continue
        if out is T_world_cam:
            out = T_world_cam.copy()
        path = out[before] @ inverse(T_odom_cam[before]) @ T_odom_cam[rows]
        out[before + 1 : after] = _fitted(path, T_world_cam[after], walk)[1:-1]
    return out


def _stretches(is_dead_reckoned: np.ndarray) -> Iterator[tuple[int, int]]:
    """Index of the frame before and of the frame after each stretch."""
    edges = np.diff(is_dead_reckoned.astype(np.int8))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) + 1
    if is_dead_reckoned[:1].any():
        ends = ends[1:]
    yield from zip(starts.tolist(), ends.tolist(), strict=False)


def _fitted(path: np.ndarray, T_end: np.ndarray, walk_of: Walk) -> np.ndarray:
    """The path [n, 4, 4], fitted so that its first pose stays and its last pose is T_end [4, 4]."""
    centres = path[:, :3, 3]
    off = np.concatenate([T_end[:3, 3] - centres[-1], so3_log(T_end[:3, :3] @ path[-1, :3, :3].T)])
    to_end = np.stack([lever(centres[-1] - centre) for centre in centres[1:]])  # [n - 1, 6, 6]
    walk = np.stack([walk_of(a, b) for a, b in pairwise(path)]) + _STILL * np.eye(6)
    scale = np.stack([_scale_effect(a, b) for a, b in pairwise(path)])
    scale_at_end = (to_end @ scale).sum(0)
    total = (to_end @ walk @ to_end.transpose(0, 2, 1)).sum(0) + scale_at_end @ scale_at_end.T
    dual = np.linalg.solve(total, off)  # [6]
    steps = walk @ to_end.transpose(0, 2, 1) @ dual + scale @ (scale_at_end.T @ dual)  # [n - 1, 6]
    out, moved = path.copy(), np.zeros(6)
    for k, step in enumerate(steps, 1):
        moved = lever(centres[k] - centres[k - 1]) @ moved + step
        out[k, :3, :3] = so3_exp(moved[3:]) @ path[k, :3, :3]
        out[k, :3, 3] += moved[:3]
    return out


def _scale_effect(T_a: np.ndarray, T_b: np.ndarray) -> np.ndarray:
    """Error of b [6, 6] by an error of scale in each component of the motion from a to b, world axes."""
    both = np.kron(np.eye(2), T_b[:3, :3])
    return both * se3_log(inverse(T_a) @ T_b)
