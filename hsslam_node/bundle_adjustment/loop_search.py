"""Loop search: finds old keyframes that are near a keyframe or that look like it."""

import numpy as np

from hsslam_node.bundle_adjustment.keyframe_alignment import KeyframeAlignment
from hsslam_node.bundle_adjustment.pose_graph import PoseEdge
from hsslam_node.bundle_adjustment.report import Rest, no_rest
from hsslam_node.config import PoseGraphConfig, TrackerConfig
from hsslam_node.geometry.se3 import inverse
from hsslam_node.map.store import KeyframeStore
from hsslam_node.place_recognition.keyframe_index import KeyframeIndex
from hsslam_node.tracking.find_loop import find_loop

_APART = 6  # keyframes on each side of a match that are skipped, as they add little
_MOST_INDEXED = 6  # keyframes that one search adds to the index, 15 ms each


class LoopSearch:
    """Proposes and verifies loops; each edge may still be wrong, and the pose graph may drop it."""

    def __init__(
        self,
        store: KeyframeStore,
        alignment: KeyframeAlignment,
        tracker: TrackerConfig,
        config: PoseGraphConfig,
        seed: int,
    ) -> None:
        self._store = store
        self._alignment = alignment
        self._tracker = tracker
        self._config = config
        self._seed = seed
        self._index = KeyframeIndex(store)

    def near(self, k: int, poses: np.ndarray, rest: Rest = no_rest) -> list[PoseEdge]:
        """Edges to old keyframes whose position and view direction are near those of keyframe k.

        It calls `rest()` before each alignment.
        """
        c = self._config
        ids = self._store.kept()
        ids = ids[ids <= k - c.loop_gap]
        old = poses[ids]  # [n, 4, 4]
        distance = np.linalg.norm(old[:, :3, 3] - poses[k, :3, 3], axis=1) / c.loop_reach_m
        angle = np.arccos(np.clip(old[:, :3, 2] @ poses[k, :3, 2], -1.0, 1.0)) / c.loop_reach_rad
        farness = np.where((distance < 1) & (angle < 1), distance + angle, np.inf)
        edges = []
        for _ in range(c.loops):
            if not np.isfinite(farness).any():
                break
            i = int(farness.argmin())
            farness[max(i - _APART, 0) : i + _APART + 1] = np.inf
            first = int(ids[i])
            rest()
            edge = self._alignment.loop(first, k, inverse(poses[first]) @ poses[k])
            if edge is not None:
                edges.append(edge)
        return edges

    def alike(self, k: int, rest: Rest = no_rest) -> list[PoseEdge]:
        """Edges to old keyframes that share features with keyframe k, at any distance.

        It calls `rest()` before each keyframe that it indexes or aligns, and before it searches the index.
        """
        for _ in range(_MOST_INDEXED):
            rest()
            if self._index.update(1) == 0:
                break
        among = np.arange(max(k - self._config.loop_gap + 1, 0))
        if len(among) == 0:
            return []
        rest()
        found = find_loop(
            self._store, self._index, k, self._tracker,
            among=among, candidates=2, seed=self._seed,
        )  # fmt: skip
        edges: list[PoseEdge] = []
        for m in found:
            rest()
            if (edge := self._alignment.loop(m.keyframe, k, m.T_keyframe_cam)) is not None:
                edges.append(edge)
        return edges
