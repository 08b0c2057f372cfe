"""A keyframe store after many minutes of motion, whose keyframes were retired and corrected all the time."""

from copy import deepcopy

import numpy as np

from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.map.allocator import ArrayAllocator
from hsslam_node.map.store import KeyframeStore

CAMERA = Camera(4, 3, 3.0, 3.0, 1.5, 1.0)
_PIXELS = np.zeros((3, 4, 3), np.uint8), np.zeros((3, 4), np.uint16)
STAYS = 1500  # every n-th keyframe is never retired
_RECENT, _ROUND = 40, 256  # newest that are kept; keyframes between corrections


class LongStore:
    """Appends keyframes, retires all but the newest and every 1500th, and corrects poses of those kept.

    `T_world_cam` [count, 4, 4]: where the keyframes should be. `anchors` [count]: what they move with.
    """

    def __init__(self, arrays: ArrayAllocator) -> None:
        self.store = KeyframeStore.create(arrays, CAMERA, 1000.0, 128)
        self.T_world_cam = np.zeros((0, 4, 4))
        self.anchors = np.zeros(0, np.int64)
        self._random = np.random.default_rng(0)

    def go_on_from(self, other: "LongStore") -> None:
        """Go on as a store whose arrays were copied."""
        self.T_world_cam, self.anchors = other.T_world_cam.copy(), other.anchors.copy()
        self._random = deepcopy(other._random)

    def extend(self, count: int) -> None:
        """Append keyframes until the store has `count`."""
        steps = self._random.normal(size=(count - self.store.count, 6), scale=0.5)
        more = np.array([*map(se3_exp, steps)])
        self.T_world_cam = np.concatenate([self.T_world_cam, more])
        for k in range(self.store.count, count):
            covariance = np.eye(6) * (k + 1)
            frame = Frame(k, k, CAMERA, *_PIXELS, 1000.0)
            self.store.append(frame, self.T_world_cam[k], covariance=covariance)
            self.anchors = np.append(self.anchors, k)
            if k >= _RECENT and (k - _RECENT) % STAYS:
                j = k - _RECENT
                self.retire(j, j + 1 if j % 10 else j - j % STAYS)
            if k % _ROUND == 0:
                self._correct()

    def retire(self, k: int, anchor: int) -> None:
        """Retire a keyframe that moves with `anchor`, which may be retired later."""
        self.store.retire(k, anchor)
        self.anchors[k] = anchor

    def _correct(self) -> None:
        count, kept = self.store.count, self.store.kept()
        before = self.T_world_cam[:count]
        twists = self._random.normal(size=(len(kept), 6), scale=1e-2)
        after = np.array([*map(se3_exp, twists)]) @ before[kept]
        self.store.correct_poses(kept, after)
        moved = np.tile(np.eye(4), (count, 1, 1))
        moved[kept] = after @ np.linalg.inv(before[kept])
        self.T_world_cam[:count] = moved[self.roots()] @ before
        self.T_world_cam[kept] = after

    def roots(self) -> np.ndarray:
        """The kept keyframe that each moves with, [count] int64."""
        root = self.anchors.copy()
        while (root != self.anchors[root]).any():
            root = self.anchors[root]
        return root
