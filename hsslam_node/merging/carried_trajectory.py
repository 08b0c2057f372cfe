"""Moves poses of frames with their keyframes; alone, as it needs only stamps and poses of maps."""

import numpy as np

from hsslam_node.geometry.se3_batch import inverse_batch
from hsslam_node.geometry.trajectory import Trajectory, by_stamp

_AROUND = 2  # keyframes before a frame in time, and as many after it
_FAR, _NEARER = 0.5, 0.5  # of these the best is farther, m; another is nearer by this factor
_AT_A_TIME = 512  # frames that are compared with all keyframes


def carried(frames: Trajectory, before: Trajectory, after: np.ndarray) -> Trajectory:
    """Each pose moved as a keyframe near it in time has moved, of several the one nearest in pose.

    Keyframes of another session with the same stamps, as of a map that was continued, are elsewhere. If all
    are far away, as of a session of which the map keeps few keyframes, the nearest of all in pose counts.

    Args:
        frames: poses in the world of `before`.
        before: old poses of the keyframes, one or more.
        after: [n, 4, 4], their new poses.
    """
    order = np.argsort(before.stamps_ns, kind="stable")
    stamps_ns = before.stamps_ns[order]
    at = np.searchsorted(stamps_ns, frames.stamps_ns)
    near = (at[:, None] + np.arange(-_AROUND, _AROUND)).clip(0, len(order) - 1)  # [N, 4]
    apart_ns = np.abs(stamps_ns[near] - frames.stamps_ns[:, None])
    near = order[np.take_along_axis(near, np.argsort(apart_ns, axis=1, kind="stable"), axis=1)]
    apart = _apart(frames.T_world_cam[:, None], before.T_world_cam[near])
    chosen = np.take_along_axis(near, apart.argmin(axis=1)[:, None], axis=1)[:, 0]
    apart = apart.min(axis=1)
    far = np.flatnonzero(apart > _FAR)
    for some in np.split(far, range(_AT_A_TIME, len(far), _AT_A_TIME)):
        to_all = _apart(frames.T_world_cam[some, None], before.T_world_cam)  # [n, keyframes]
        is_nearer = to_all.min(axis=1, initial=np.inf) < _NEARER * apart[some]
        chosen[some[is_nearer]] = to_all[is_nearer].argmin(axis=1)
    moved = after[chosen] @ inverse_batch(before.T_world_cam[chosen])  # [N, 4, 4]
    return Trajectory(frames.stamps_ns, moved @ frames.T_world_cam)


def _apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Distance of poses [..., 4, 4]: that of the centres, m, and the turn; a radian counts as a metre."""
    turn = np.linalg.norm(a[..., :3, :3] - b[..., :3, :3], axis=(-2, -1)) / np.sqrt(2.0)
    return np.linalg.norm(a[..., :3, 3] - b[..., :3, 3], axis=-1) + turn


def joined(first: Trajectory, second: Trajectory) -> Trajectory:
    """The poses of both in the order of their stamps."""
    stamps_ns = np.concatenate([first.stamps_ns, second.stamps_ns])
    return by_stamp(Trajectory(stamps_ns, np.concatenate([first.T_world_cam, second.T_world_cam])))
