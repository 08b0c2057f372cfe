"""Moves poses of frames with their keyframes; alone, as it needs only stamps and poses of maps."""

import numpy as np

from hsslam_node.geometry.se3_batch import inverse_batch
from hsslam_node.geometry.trajectory import Trajectory, by_stamp


def carried(frames: Trajectory, before: Trajectory, after: np.ndarray) -> Trajectory:
    """Each pose moved as the keyframe nearest in time has moved.

    Args:
        frames: poses in the world of `before`.
        before: old poses of the keyframes, one or more.
        after: [n, 4, 4], their new poses.
    """
    order = np.argsort(before.stamps_ns, kind="stable")
    stamps_ns = before.stamps_ns[order]
    later = np.clip(np.searchsorted(stamps_ns, frames.stamps_ns), 1, max(len(order) - 1, 1))
    later = np.minimum(later, len(order) - 1)
    earlier = np.maximum(later - 1, 0)
    is_earlier = frames.stamps_ns - stamps_ns[earlier] <= stamps_ns[later] - frames.stamps_ns
    nearest = order[np.where(is_earlier, earlier, later)]
    moved = after[nearest] @ inverse_batch(before.T_world_cam[nearest])  # [N, 4, 4]
    return Trajectory(frames.stamps_ns, moved @ frames.T_world_cam)


def joined(first: Trajectory, second: Trajectory) -> Trajectory:
    """The poses of both in the order of their stamps."""
    stamps_ns = np.concatenate([first.stamps_ns, second.stamps_ns])
    return by_stamp(Trajectory(stamps_ns, np.concatenate([first.T_world_cam, second.T_world_cam])))
