"""Keyframe poses by alignment of keyframes to each other, solved as a pose graph; the map follows."""

from contextlib import nullcontext
from dataclasses import replace
from functools import reduce

import numpy as np

from hsslam_node.bundle_adjustment.global_ba import GlobalBundleAdjustment
from hsslam_node.bundle_adjustment.keyframe_alignment import KeyframeAlignment, difference
from hsslam_node.bundle_adjustment.loop_search import LoopSearch
from hsslam_node.bundle_adjustment.pose_graph import PoseEdge, PoseEdges, solve_pose_graph
from hsslam_node.bundle_adjustment.report import BaReport, Lease, MayStep, always
from hsslam_node.config import SlamConfig
from hsslam_node.device.device import CPU, Device
from hsslam_node.geometry.se3 import inverse
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore

_LOST_WEIGHT = 0.02  # edges that have faded below it are forgotten
_ALIKE_EVERY = 4  # rounds: the newest keyframe is compared with all that look alike, 80 ms
_SURPRISE_M, _SURPRISE_RAD = 0.01, 0.005  # a loop that is off by more asks for all poses


class GraphBundleAdjustment:
    """Each round aligns the new keyframes to those before them and to those of long ago that see the
    same, and solves for the poses; then the map is refined where it is rendered badly (paper III-C).

    The tracked motion from keyframe to keyframe is a weak prior. Keyframe 0 never moves. A restarted
    one takes the poses as they are.
    """

    def __init__(
        self, config: SlamConfig, parameters: FieldParameters, seed: int, device: Device = CPU
    ) -> None:
        map_only = replace(config, ba=replace(config.ba, pose_rate=0.0))
        self._map = GlobalBundleAdjustment(map_only, parameters, seed, device)
        self._slam = config
        self._config = config.pose_graph
        self._seed = seed
        self._alignment: KeyframeAlignment | None = None
        self._loops: LoopSearch | None = None
        self._edges: list[PoseEdge] = []
        self._tracked: list[PoseEdge] = []  # from each keyframe to the next
        self._seen = 1  # keyframes that have their edges
        self._rounds = 0
        self._all_at_next = False

    def is_due(self, store: KeyframeStore) -> bool:
        """Whether enough keyframes have come since the last round."""
        return self._map.is_due(store)

    def round(
        self, store: KeyframeStore, lease: Lease = nullcontext, may_step: MayStep = always
    ) -> BaReport:
        """Measure, solve, refine the map. `lease()` is held while the map is stepped, not before.

        Where `may_step()` says no, the round ends, and what was solved for is left to the next.
        """
        poses = store.poses()
        closed = self._measure(store, poses)
        all_asked = self._all_at_next
        solved = self._solved(poses)
        mapped = self._map.round(store, lease, may_step)
        if not may_step():
            self._all_at_next = all_asked
            return replace(mapped, moved=False, loops=closed)
        shift_m = np.linalg.norm(solved[:, :3, 3] - poses[:, :3, 3], axis=1)
        if shift_m.max() < self._config.least_shift_m:
            return replace(mapped, moved=False, loops=closed)
        now = store.poses()
        follow = solved[-1] @ inverse(poses[-1])  # those that came meanwhile
        corrected = np.concatenate([solved, follow @ now[len(poses) :]])
        ids = np.flatnonzero((corrected != now).any(axis=(1, 2)))
        return BaReport(
            ids, corrected[ids], mapped.loss_before, mapped.loss_after, moved=True, loops=closed
        )

    def _measure(self, store: KeyframeStore, poses: np.ndarray) -> tuple[tuple[int, int], ...]:
        """Edges of the keyframes that are new; returns the loops they close."""
        c = self._config
        if self._alignment is None or self._loops is None:
            tracker = self._slam.tracker
            self._alignment = KeyframeAlignment(store, tracker, c, self._seed)
            self._loops = LoopSearch(store, self._alignment, tracker, c, self._seed)
        count = len(poses)
        for k in range(self._seen, count):
            self._add_tracked(k, inverse(poses[k - 1]) @ poses[k])
        loops: list[PoseEdge] = []
        oldest = max(self._seen, count - c.most_keyframes)
        for k in range(count - 1, oldest - 1, -c.aligned_every):
            near = {
                gap: self._alignment.neighbour(k - gap, k, inverse(poses[k - gap]) @ poses[k])
                for gap in c.neighbours
                if gap <= k
            }
            aligned = {gap: edge for gap, edge in near.items() if edge is not None}
            self._edges += aligned.values()
            self._doubt_tracked(k, aligned)
            loops += self._loops.near(k, poses)
        if self._rounds % _ALIKE_EVERY == 0 and c.loops and not loops:
            loops += self._loops.alike(count - 1)
        self._rounds += 1
        self._seen = count
        self._edges += loops
        self._all_at_next |= any(_is_surprising(edge, poses) for edge in loops)
        return tuple((edge.first, edge.second) for edge in loops)

    def _add_tracked(self, k: int, T: np.ndarray) -> None:
        """The tracked motion `T` since the keyframe before, and that since one some way back."""
        c = self._config
        information = _information(c.odometry_sigma_m, c.odometry_sigma_rad)
        self._tracked.append(PoseEdge(k - 1, k, T, information, False))
        if k >= c.anchor_gap > 1:
            over = reduce(np.matmul, [e.T_first_second for e in self._tracked[-c.anchor_gap :]])
            information = _information(c.anchor_sigma_m, c.anchor_sigma_rad)
            self._edges.append(PoseEdge(k - c.anchor_gap, k, over, information, True))

    def _doubt_tracked(self, k: int, aligned: dict[int, PoseEdge]) -> None:
        """Tracked motion counts for less where the keyframes' alignment to keyframe k contradicts it,
        as after a jump."""
        c = self._config
        T_k = {0: np.eye(4)} | {gap: inverse(e.T_first_second) for gap, e in aligned.items()}
        for gap in aligned:
            if gap - 1 not in T_k:
                continue
            edge = self._tracked[k - gap]  # to the keyframe after k - gap
            apart_m, apart_rad = difference(edge.T_first_second, inverse(T_k[gap]) @ T_k[gap - 1])
            worse = max(1.0, apart_m / c.odometry_sigma_m, apart_rad / c.odometry_sigma_rad)
            information = _information(worse * c.odometry_sigma_m, worse * c.odometry_sigma_rad)
            self._tracked[k - gap] = replace(edge, information=information)

    def _solved(self, poses: np.ndarray) -> np.ndarray:
        """All poses [n, 4, 4], the newest of them solved for; all, where a loop asks for it."""
        n = len(poses)
        oldest = 1 if self._all_at_next else max(1, n - self._config.window)
        fixed = np.arange(n) < oldest
        used = [i for i, e in enumerate(self._edges) if e.second >= oldest]
        edges = PoseEdges.of([self._edges[i] for i in used] + self._tracked[oldest - 1 :])
        result = solve_pose_graph(poses, edges, fixed, kernel=self._config.kernel)
        lost = {i for i, w in zip(used, result.weights, strict=False) if w < _LOST_WEIGHT}
        self._edges = [e for i, e in enumerate(self._edges) if i not in lost]
        self._all_at_next = False
        return result.T_world_cam


def _is_surprising(edge: PoseEdge, poses: np.ndarray) -> bool:
    now = inverse(poses[edge.first]) @ poses[edge.second]
    apart_m, apart_rad = difference(now, edge.T_first_second)
    return apart_m > _SURPRISE_M or apart_rad > _SURPRISE_RAD


def _information(sigma_m: float, sigma_rad: float) -> np.ndarray:
    return np.diag(np.repeat([sigma_m**-2, sigma_rad**-2], 3))
