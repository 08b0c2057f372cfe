"""The tracked motion from keyframe to keyframe, on which the pose graph hangs."""

from dataclasses import replace
from functools import reduce

import numpy as np

from hsslam_node.bundle_adjustment.keyframe_alignment import difference
from hsslam_node.bundle_adjustment.pose_graph import PoseEdge
from hsslam_node.config import PoseGraphConfig
from hsslam_node.geometry.se3 import inverse

_LOST_M, _LOST_RAD = 0.1, 0.05  # what a join is good to


class TrackedChain:
    """An edge from each keyframe of the graph to the next one; it begins at keyframe 0, which stays."""

    def __init__(self, config: PoseGraphConfig) -> None:
        self._config = config
        self._to: dict[int, PoseEdge] = {}  # by its second keyframe, in their order
        self._lost_at = 0  # the newest keyframe before which the camera was lost

    @property
    def keyframes(self) -> np.ndarray:
        """Ids of the keyframes of the graph, sorted [n] int64."""
        return np.array([0, *self._to], np.int64)

    def edges_to(self, keyframes: np.ndarray) -> list[PoseEdge]:
        """The edges that end at these keyframes."""
        return [self._to[int(k)] for k in keyframes]

    def add(self, k: int, T: np.ndarray, *, was_lost: bool = False) -> list[PoseEdge]:
        """The tracked motion `T` since the keyframe before; returns that since one some way back, if any.

        `was_lost`: the camera was lost between the two, so `T` is a guess on which the graph hangs."""
        c = self._config
        if was_lost:
            self._to[k] = PoseEdge(k - 1, k, T, _information(_LOST_M, _LOST_RAD), False)
            self._lost_at = k
            return []
        information = _information(c.odometry_sigma_m, c.odometry_sigma_rad)
        self._to[k] = PoseEdge(k - 1, k, T, information, False)
        way = [self._to.get(j) for j in range(k - c.anchor_gap + 1, k + 1)]
        links = [edge for edge in way if edge is not None and edge.first == edge.second - 1]
        if k - self._lost_at < c.anchor_gap or c.anchor_gap <= 1 or len(links) < c.anchor_gap:
            return []
        over = reduce(np.matmul, [edge.T_first_second for edge in links])
        information = _information(c.anchor_sigma_m, c.anchor_sigma_rad)
        return [PoseEdge(k - c.anchor_gap, k, over, information, True)]

    def doubt(self, k: int, aligned: dict[int, PoseEdge]) -> None:
        """Tracked motion counts for less where the keyframes' alignment to keyframe k (by their distance
        from it) contradicts it, as after a jump."""
        c = self._config
        T_k = {0: np.eye(4)} | {gap: inverse(e.T_first_second) for gap, e in aligned.items()}
        for gap in aligned:
            edge = self._to.get(k - gap + 1)
            if gap - 1 not in T_k or edge is None or edge.first != k - gap:
                continue
            apart_m, apart_rad = difference(edge.T_first_second, inverse(T_k[gap]) @ T_k[gap - 1])
            worse = max(1.0, apart_m / c.odometry_sigma_m, apart_rad / c.odometry_sigma_rad)
            information = _information(worse * c.odometry_sigma_m, worse * c.odometry_sigma_rad)
            self._to[k - gap + 1] = replace(edge, information=information)

    def retain(self, kept: set[int], poses: np.ndarray) -> bool:
        """Let go of the keyframes that are not kept; returns whether there were any.

        What lay between two that are kept becomes one edge: as they stand to each other by the poses
        [n, 4, 4] of now, as sure as the motion between them was.
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


def _information(sigma_m: float, sigma_rad: float) -> np.ndarray:
    return np.diag(np.repeat([sigma_m**-2, sigma_rad**-2], 3))
