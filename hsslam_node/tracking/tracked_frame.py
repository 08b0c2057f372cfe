"""A frame that was tracked, and where the next one is expected."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse, se3_exp, se3_log
from hsslam_node.map.store import KeyframeStore

_LONGEST_EXTRAPOLATION = 4.0  # of the last motion, in its own length


@dataclass(frozen=True)
class TrackedFrame:
    """A frame that was tracked, placed relative to a keyframe, so that it follows corrections."""

    frame: Frame
    keyframe: int
    T_keyframe_cam: np.ndarray  # [4, 4]

    def pose(self, store: KeyframeStore) -> np.ndarray:
        """T_world_cam [4, 4] by the keyframe's pose as it is now."""
        return store.pose(self.keyframe) @ self.T_keyframe_cam


def predicted_pose(
    last: TrackedFrame,
    before: TrackedFrame | None,
    store: KeyframeStore,
    stamp_ns: int,
    longest: float = _LONGEST_EXTRAPOLATION,
) -> np.ndarray:
    """T_world_cam [4, 4] at stamp_ns by constant SE(3) velocity; at rest without a frame before.

    longest: the last motion is carried on at most so many times its own length.
    """
    T_last = last.pose(store)
    if before is None:
        return T_last
    share = np.clip(_reach(last, before, stamp_ns), 0.0, longest)
    return T_last @ se3_exp(share * se3_log(inverse(before.pose(store)) @ T_last))


def is_foreseen(last: TrackedFrame, before: TrackedFrame | None, stamp_ns: int) -> bool:
    """Whether the last motion tells where the camera is at stamp_ns: not after a gap."""
    return before is not None and _reach(last, before, stamp_ns) <= _LONGEST_EXTRAPOLATION


def _reach(last: TrackedFrame, before: TrackedFrame, stamp_ns: int) -> float:
    """From the last frame to stamp_ns in times between the last two; 0 where there is none between."""
    past_ns = last.frame.stamp_ns - before.frame.stamp_ns
    return (stamp_ns - last.frame.stamp_ns) / past_ns if past_ns > 0 else 0.0


def orthonormal(T: np.ndarray) -> np.ndarray:
    """T [4, 4] with rounding errors of many products removed from its rotation."""
    U, _, Vt = np.linalg.svd(T[:3, :3])
    out = T.copy()
    out[:3, :3] = U @ Vt
    return out
