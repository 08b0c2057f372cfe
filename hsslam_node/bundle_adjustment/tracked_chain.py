"""The tracked motion from keyframe to keyframe, which connects the whole pose graph."""

from dataclasses import replace
from functools import reduce

import numpy as np

from hsslam_node.bundle_adjustment.keyframe_alignment import difference
from hsslam_node.bundle_adjustment.pose_graph import PoseEdge
from hsslam_node.config import PoseGraphConfig
from hsslam_node.geometry.se3 import inverse

_NO_GAP = np.zeros((6, 6))


class TrackedChain:
    """Edges from each keyframe of the graph to the next one. Keyframe 0, the first, never leaves."""

    def __init__(self, config: PoseGraphConfig) -> None:
        self._config = config
        self._to: dict[int, PoseEdge] = {}  # by second keyframe, ascending
        # [6, 6] covariance of gaps that odometry bridged, by second keyframe
        self._gaps: dict[int, np.ndarray] = {}

    @property
    def keyframes(self) -> np.ndarray:
        """Ids of the keyframes of the graph, sorted [n] int64."""
        return np.array([0, *self._to], np.int64)

    def edges_to(self, keyframes: np.ndarray) -> list[PoseEdge]:
        """The edges that end at these keyframes."""
        return [self._to[int(k)] for k in keyframes]

    def add(self, k: int, T: np.ndarray, gap_covariance: np.ndarray = _NO_GAP) -> list[PoseEdge]:
        """Add the tracked motion `T` [4, 4] since the keyframe before. Returns an edge from the keyframe
        `anchor_gap` before, if the camera was aligned all the way.

        gap_covariance: [6, 6] of the part that odometry alone bridged, as in `KeyframeStore.append`.
        """
        c = self._config
        if gap_covariance.any():
            self._gaps[k] = gap_covariance
        self._to[k] = PoseEdge(k - 1, k, T, self._tracked(k), False)
        way = [self._to.get(j) for j in range(k - c.anchor_gap + 1, k + 1) if j not in self._gaps]
        links = [edge for edge in way if edge is not None and edge.first == edge.second - 1]
        if k < c.anchor_gap or c.anchor_gap <= 1 or len(links) < c.anchor_gap:
            return []
        over = reduce(np.matmul, [edge.T_first_second for edge in links])
        information = _information(c.anchor_sigma_m, c.anchor_sigma_rad)
        return [PoseEdge(k - c.anchor_gap, k, over, information, True)]

    def doubt(self, k: int, aligned: dict[int, PoseEdge]) -> None:
        """Lower the weight of tracked motion that alignments contradict, as after a jump. `aligned`: edges
        from earlier keyframes to keyframe k, by their distance in keyframes."""
        c = self._config
        T_k = {0: np.eye(4)} | {gap: inverse(e.T_first_second) for gap, e in aligned.items()}
        for gap in aligned:
            edge = self._to.get(k - gap + 1)
            if gap - 1 not in T_k or edge is None or edge.first != k - gap:
                continue
            apart_m, apart_rad = difference(edge.T_first_second, inverse(T_k[gap]) @ T_k[gap - 1])
            worse = max(1.0, apart_m / c.odometry_sigma_m, apart_rad / c.odometry_sigma_rad)
            information = self._tracked(edge.second, worse)
            self._to[edge.second] = replace(edge, information=information)

    def retain(self, kept: set[int], poses: np.ndarray) -> bool:
        """Remove the keyframes that are not kept; return whether there were any.

        One edge joins two kept keyframes across the removed ones: its pose is that of `poses` [n, 4, 4], its
        covariance the sum of those between them.
        """
        if all(k in kept for k in self._to):
            return False
        chain: dict[int, PoseEdge] = {}
        first, covariance = 0, np.zeros((6, 6))
        for k, edge in self._to.items():
            if k in kept and edge.first == first:
                chain[k] = edge
            else:
                covariance = covariance + np.linalg.inv(edge.information)
                if k not in kept:
                    continue
                T = inverse(poses[first]) @ poses[k]
                chain[k] = PoseEdge(first, k, T, np.linalg.inv(covariance), False)
            first, covariance = k, np.zeros((6, 6))
        self._to = chain
        return True

    def _tracked(self, k: int, worse: float = 1.0) -> np.ndarray:
        """Information [6, 6] of the motion to keyframe k, at `worse` times the usual standard deviation."""
        c = self._config
        usual = _information(worse * c.odometry_sigma_m, worse * c.odometry_sigma_rad)
        gap = self._gaps.get(k)
        return usual if gap is None else np.linalg.inv(np.linalg.inv(usual) + gap)


def _information(sigma_m: float, sigma_rad: float) -> np.ndarray:
    return np.diag(np.repeat([sigma_m**-2, sigma_rad**-2], 3))
