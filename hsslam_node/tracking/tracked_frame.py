"""A frame that was tracked, and where the next one is expected."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse, se3_exp, se3_log
from hsslam_node.keyframes.store import KeyframeStore

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
    last: TrackedFrame, before: TrackedFrame | None, store: KeyframeStore, stamp_ns: int
) -> np.ndarray:
    """T_world_cam [4, 4] at stamp_ns by constant SE(3) velocity; at rest without a frame before."""
    T_last = last.pose(store)
    if before is None or last.frame.stamp_ns <= before.frame.stamp_ns:
        return T_last
    past_ns = last.frame.stamp_ns - before.frame.stamp_ns
    share = np.clip((stamp_ns - last.frame.stamp_ns) / past_ns, 0.0, _LONGEST_EXTRAPOLATION)
    return T_last @ se3_exp(share * se3_log(inverse(before.pose(store)) @ T_last))


def orthonormal(T: np.ndarray) -> np.ndarray:
    """T [4, 4] with rounding errors of many products removed from its rotation."""
    U, _, Vt = np.linalg.svd(T[:3, :3])
    out = T.copy()
    out[:3, :3] = U @ Vt
    return out
