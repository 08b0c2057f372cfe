"""Bundle adjustment by a pose graph: its edges are alignments between keyframes, and the map follows."""

from collections.abc import Iterable
from contextlib import nullcontext
from dataclasses import replace

import numpy as np

from hsslam_node.bundle_adjustment.adjustment import BundleAdjustment
from hsslam_node.bundle_adjustment.global_ba import GlobalBundleAdjustment
from hsslam_node.bundle_adjustment.keyframe_alignment import KeyframeAlignment, difference
from hsslam_node.bundle_adjustment.loop_search import LoopSearch
from hsslam_node.bundle_adjustment.pose_graph import PoseEdge, PoseEdges, solve_pose_graph
from hsslam_node.bundle_adjustment.report import BaReport, Lease, MayStep, Rest, always, no_rest
from hsslam_node.bundle_adjustment.tracked_chain import TrackedChain
from hsslam_node.config import SlamConfig
from hsslam_node.device.device import CPU, Device
from hsslam_node.geometry.se3 import inverse
from hsslam_node.geometry.view_distance import surface_shift_m
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore

_LOST_WEIGHT = 0.02  # an edge of a smaller weight leaves the graph
_ALIKE_EVERY = 4  # rounds between searches for keyframes that look alike, 80 ms
_ADDED_AT_ONCE = 512  # keyframes whose tracked motion is added without a rest, 50 ms
_SURPRISE_M, _SURPRISE_RAD = 0.01, 0.005  # a loop that is off by more frees all poses


class GraphBundleAdjustment(BundleAdjustment):
    """Each round aligns new keyframes to recent ones and to old ones that see the same place, and solves for
    the poses. Then it refines the map at the keyframes that it renders worst (paper III-C).

    The tracked motion from keyframe to keyframe is a weak prior. Keyframe 0 never moves. A restarted process
    takes the poses as they are. Retired keyframes leave the graph with their edges.
    """

    def __init__(
        self, config: SlamConfig, parameters: FieldParameters, seed: int, device: Device = CPU
    ) -> None:
        super().__init__(config.ba.every_keyframes)
        map_only = replace(config, ba=replace(config.ba, pose_rate=0.0))
        self._map = GlobalBundleAdjustment(map_only, parameters, seed, device)
        self._slam = config
        self._config = config.pose_graph
        self._seed = seed
        self._alignment: KeyframeAlignment | None = None
        self._loops: LoopSearch | None = None
        self._edges: list[PoseEdge] = []
        self._chain = TrackedChain(config.pose_graph)
        self._left: list[int] = []  # new keyframes that are still to be aligned, newest first
        self._rounds = 0
        self._all_at_next = False

    def is_behind(self, store: KeyframeStore) -> bool:
        """Whether there are keyframes that no round has aligned."""
        return bool(self._left) or super().is_behind(store)

    def round(
        self,
        store: KeyframeStore,
        lease: Lease = nullcontext,
        may_step: MayStep = always,
        rest: Rest = no_rest,
    ) -> BaReport:
        """Align, solve, refine the map. It holds `lease()` only to step the map, and calls `rest()` before
        each alignment of two keyframes and before each step of the map. No pose moves if `may_step()` returns
        False, or if the solution moves surfaces by less than `least_shift_m`; the next round solves again.
        """
        poses = store.poses()
        closed = self._measure(store, poses, rest)
        all_asked = self._all_at_next
        nodes = self._chain.keyframes
        then, solved = poses[nodes], self._solved(nodes, poses[nodes])
        mapped = self._map.round(store, lease, may_step, rest)
        if not may_step() or surface_shift_m(then, solved) < self._config.least_shift_m:
            self._all_at_next = all_asked
            return replace(mapped, moved=False, loops=closed)
        has_moved = (solved != then).any(axis=(1, 2))
        return replace(
            mapped, keyframes=nodes[has_moved], T_then=then[has_moved], T_world_cam=solved[has_moved],
            moved=True, loops=closed, known=len(poses),
        )  # fmt: skip

    def _measure(
        self, store: KeyframeStore, poses: np.ndarray, rest: Rest
    ) -> tuple[tuple[int, int], ...]:
        """Add the edges of the new keyframes; return the loops that they close."""
        c = self._config
        if self._alignment is None or self._loops is None:
            tracker = self._slam.tracker
            self._alignment = KeyframeAlignment(store, tracker, c, self._seed)
            self._loops = LoopSearch(store, self._alignment, tracker, c, self._seed)
        count = len(poses)
        fragments = store.fragments()[:count]
        kept = self._add_tracked(store, poses, rest)
        loops: list[PoseEdge] = []
        due = [*range(count - 1, self._used - 1, -c.aligned_every), *self._left]
        most = -(-c.most_keyframes // c.aligned_every)
        # align all of a fragment that has just joined
        if self._rounds and store.joined_since(self._used, count):
            most = len(due)
            self._all_at_next = True
        self._left = [k for k in due[most:] if k in kept and k >= store.inherited]
        for k in due[:most]:
            aligned: dict[int, PoseEdge] = {}
            for gap in c.neighbours:
                if k - gap in kept and k in kept and fragments[k - gap] == fragments[k]:
                    rest()
                    T = inverse(poses[k - gap]) @ poses[k]
                    if (edge := self._alignment.neighbour(k - gap, k, T)) is not None:
                        aligned[gap] = edge
            self._edges += aligned.values()
            self._chain.doubt(k, aligned)
            loops += self._loops.near(k, poses, rest) if k in kept else []
        if self._rounds % _ALIKE_EVERY == 0 and c.loops and not loops:
            loops += self._loops.alike(count - 1, rest)
        rest()
        self._rounds += 1
        self._used = count
        self._edges += loops
        self._all_at_next |= any(_is_surprising(edge, poses) for edge in loops)
        return tuple((edge.first, edge.second) for edge in loops)

    def _add_tracked(self, store: KeyframeStore, poses: np.ndarray, rest: Rest) -> set[int]:
        """Add the tracked motion to the new keyframes, and remove retired keyframes; return the kept ones.

        After a restart all keyframes are new, and most are retired: it removes some before it adds more.
        """
        count = len(poses)
        for first in range(self._used, count, _ADDED_AT_ONCE):
            end = min(first + _ADDED_AT_ONCE, count)
            for k in range(first, end):
                T = inverse(poses[k - 1]) @ poses[k]
                self._edges += self._chain.add(k, T, store.gap_covariance(k))
            if end < count:  # the next edges begin at the newest keyframes
                self._drop_retired(store, poses, range(end - self._config.anchor_gap, end))
                rest()
        return self._drop_retired(store, poses)

    def _drop_retired(
        self, store: KeyframeStore, poses: np.ndarray, but: Iterable[int] = ()
    ) -> set[int]:
        """Remove retired keyframes from the graph, but not those of `but`; return the others."""
        ids = store.kept()
        kept = set(ids[ids < len(poses)].tolist()).union(but)
        if self._chain.retain(kept, poses):
            self._edges = [e for e in self._edges if e.first in kept and e.second in kept]
        return kept

    def _solved(self, nodes: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """The poses [n, 4, 4] of the keyframes `nodes` [n] of the graph, after solving for the newest, or for
        all if `_all_at_next`."""
        n = len(nodes)
        oldest = 1 if self._all_at_next else max(1, n - self._config.window)
        fixed = np.arange(n) < oldest
        free = set(nodes[oldest:].tolist())
        used = [i for i, e in enumerate(self._edges) if e.second in free]
        edges = PoseEdges.of([self._edges[i] for i in used] + self._chain.edges_to(nodes[oldest:]))
        rows = replace(
            edges,
            first=np.searchsorted(nodes, edges.first),
            second=np.searchsorted(nodes, edges.second),
        )
        result = solve_pose_graph(poses, rows, fixed, kernel=self._config.kernel)
        lost = {i for i, w in zip(used, result.weights, strict=False) if w < _LOST_WEIGHT}
        self._edges = [e for i, e in enumerate(self._edges) if i not in lost]
        self._all_at_next = False
        return result.T_world_cam


def _is_surprising(edge: PoseEdge, poses: np.ndarray) -> bool:
    now = inverse(poses[edge.first]) @ poses[edge.second]
    apart_m, apart_rad = difference(now, edge.T_first_second)
    return apart_m > _SURPRISE_M or apart_rad > _SURPRISE_RAD
