"""Moves the keyframes that follow a correction of others: retired ones, and those appended meanwhile."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.geometry.se3 import inverse
from hsslam_node.geometry.se3_batch import inverse_batch


@dataclass(frozen=True)
class PoseCorrection:
    """The keyframes that a correction has moved, with retired ones and those appended meanwhile."""

    version: int  # of the poses from now on
    keyframes: np.ndarray  # [n] ids, sorted
    T_world_cam: np.ndarray  # [n, 4, 4]

    def with_more(self, other: "PoseCorrection") -> "PoseCorrection":
        """This correction and a later one of newer keyframes."""
        return PoseCorrection(
            other.version,
            np.append(self.keyframes, other.keyframes),
            np.concatenate([self.T_world_cam, other.T_world_cam]),
        )


def on_top(then: np.ndarray, now: np.ndarray, corrected: np.ndarray) -> np.ndarray:
    """Poses `corrected` [n, 4, 4], computed from poses `then`, which others have moved to `now` meanwhile:
    both changes count, one after the other."""
    both = corrected.copy()
    moved = (now != then).any(axis=(1, 2))
    both[moved] = now[moved] @ inverse_batch(then[moved]) @ corrected[moved]
    return both


def follow_references(
    before: np.ndarray, after: np.ndarray, late: np.ndarray, references: np.ndarray
) -> None:
    """Move keyframes `late` [m], sorted, in `after` [n, 4, 4] as their references have moved; a keyframe
    without one stays. references: [n] int64, as in `KeyframeRows.references`."""
    for k in late.tolist():
        r = int(references[k])
        if r >= 0 and (after[r] != before[r]).any():
            after[k] = after[r] @ inverse(before[r]) @ before[k]


def roots(is_kept: np.ndarray, anchors: np.ndarray) -> np.ndarray:
    """The kept keyframe that each moves with, itself if it is kept, [n] int64; -1: none.

    Args:
        is_kept: [n] bool.
        anchors: [n] int64, the keyframe that each moves with once it is retired, which may be retired too;
            -1: none.
    """
    root = np.where(is_kept, np.arange(len(is_kept)), anchors)
    while not (is_kept[root] | (root < 0)).all():
        root = np.where(is_kept[root] | (root < 0), root, root[root])
    return root


def carry_retired(before: np.ndarray, after: np.ndarray, root: np.ndarray) -> None:
    """Move retired keyframes in `after` [n, 4, 4] with the kept ones `root` [n], as of `roots`."""
    has_moved = (after != before).any(axis=(1, 2))
    moved = (root != np.arange(len(root))) & (root >= 0) & has_moved[root]
    to, place = np.unique(root[moved], return_inverse=True)  # few: the others are retired
    after[moved] = (after[to] @ inverse_batch(before[to]))[place] @ before[moved]
