"""Keyframe poses by alignment of keyframes to each other, solved as a pose graph; the map follows."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np

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

_LOST_WEIGHT = 0.02  # edges that have faded below it are forgotten
_ALIKE_EVERY = 4  # rounds: the newest keyframe is compared with all that look alike, 80 ms
_SURPRISE_M, _SURPRISE_RAD = 0.01, 0.005  # a loop that is off by more asks for all poses


class GraphBundleAdjustment:
    """Each round aligns the new keyframes to those before them and to those of long ago that see the
    same, and solves for the poses; then the map is refined where it is rendered badly (paper III-C).

    The tracked motion from keyframe to keyframe is a weak prior. Keyframe 0 never moves. A restarted
    one takes the poses as they are. Keyframes that are retired leave the graph with their edges.
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
        self._chain = TrackedChain(config.pose_graph)
        self._seen = 1  # keyframes that have their edges
        self._left: list[int] = []  # keyframes that rounds were too short for, newest first
        self._rounds = 0
        self._all_at_next = False

    def is_due(self, store: KeyframeStore) -> bool:
        """Whether enough keyframes have come since the last round."""
        return store.count - self._adjusted(store) >= self._slam.ba.every_keyframes

    def is_behind(self, store: KeyframeStore) -> bool:
        """Whether keyframes have come that no round has looked at, or were left to the next."""
        return bool(self._left) or store.count > self._adjusted(store)

    def has_joined(self, store: KeyframeStore) -> bool:
        """Whether a fragment has joined the map since the last round."""
        fragments = store.fragments()[self._adjusted(store) - 1 :]
        return bool((fragments != fragments[:1]).any())

    def round(
        self,
        store: KeyframeStore,
        lease: Lease = nullcontext,
        may_step: MayStep = always,
        rest: Rest = no_rest,
    ) -> BaReport:
        """Measure, solve, refine the map. `lease()` is held while the map is stepped, not before.

        Where `may_step()` says no, the round ends, and what was solved for is left to the next. So it is
        where that moves no surface by `least_shift_m`.
        `rest()` is called before each keyframe that is aligned and each step of the map.
        """
        poses = store.poses()
        closed = self._measure(store, poses, rest)
        all_asked = self._all_at_next
        solved = self._solved(poses)
        mapped = self._map.round(store, lease, may_step, rest)
        if not may_step() or surface_shift_m(poses, solved) < self._config.least_shift_m:
            self._all_at_next = all_asked
            return replace(mapped, moved=False, loops=closed)
        ids = np.flatnonzero((solved != poses).any(axis=(1, 2)))
        return replace(
            mapped, keyframes=ids, T_then=poses[ids], T_world_cam=solved[ids], moved=True,
            loops=closed, known=len(poses),
        )  # fmt: skip

    def _adjusted(self, store: KeyframeStore) -> int:
        """Keyframes that were there at the last round, here or in the run that saved the map."""
        return max(self._seen, store.inherited)

    def _measure(
        self, store: KeyframeStore, poses: np.ndarray, rest: Rest
    ) -> tuple[tuple[int, int], ...]:
        """Edges of the keyframes that are new; returns the loops they close."""
        c = self._config
        if self._alignment is None or self._loops is None:
            tracker = self._slam.tracker
            self._alignment = KeyframeAlignment(store, tracker, c, self._seed)
            self._loops = LoopSearch(store, self._alignment, tracker, c, self._seed)
        count = len(poses)
        fragments = store.fragments()[:count]
        for k in range(self._seen, count):
            T = inverse(poses[k - 1]) @ poses[k]
            self._edges += self._chain.add(k, T, store.gap_covariance(k))
        kept = self._let_retired_go(store, count, poses)
        loops: list[PoseEdge] = []
        due = [*range(count - 1, self._seen - 1, -c.aligned_every), *self._left]
        most = -(-c.most_keyframes // c.aligned_every)
        new = fragments[self._seen - 1 :]
        if (new != new[0]).any() and self._rounds:  # all of a fragment that was joined just now
            most = len(due)
            self._all_at_next = True
        self._left = [k for k in due[most:] if k in kept and k >= store.inherited]
        for k in due[:most]:
            rest()
            near = {
                gap: self._alignment.neighbour(k - gap, k, inverse(poses[k - gap]) @ poses[k])
                for gap in c.neighbours
                if k - gap in kept and k in kept and fragments[k - gap] == fragments[k]
            }
            aligned = {gap: edge for gap, edge in near.items() if edge is not None}
            self._edges += aligned.values()
            self._chain.doubt(k, aligned)
            loops += self._loops.near(k, poses) if k in kept else []
        if self._rounds % _ALIKE_EVERY == 0 and c.loops and not loops:
            loops += self._loops.alike(count - 1)
        self._rounds += 1
        self._seen = count
        self._edges += loops
        self._all_at_next |= any(_is_surprising(edge, poses) for edge in loops)
        return tuple((edge.first, edge.second) for edge in loops)

    def _let_retired_go(self, store: KeyframeStore, count: int, poses: np.ndarray) -> set[int]:
        """The keyframes below `count` that are kept; the others leave the graph."""
        ids = store.kept()
        kept = set(ids[ids < count].tolist())
        if self._chain.retain(kept, poses):
            self._edges = [e for e in self._edges if e.first in kept and e.second in kept]
        return kept

    def _solved(self, poses: np.ndarray) -> np.ndarray:
        """All poses [n, 4, 4], the newest in the graph solved for; all there, where a loop asks for it."""
        nodes = self._chain.keyframes
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
        result = solve_pose_graph(poses[nodes], rows, fixed, kernel=self._config.kernel)
        lost = {i for i, w in zip(used, result.weights, strict=False) if w < _LOST_WEIGHT}
        self._edges = [e for i, e in enumerate(self._edges) if i not in lost]
        self._all_at_next = False
        solved = poses.copy()
        solved[nodes] = result.T_world_cam
        return solved


def _is_surprising(edge: PoseEdge, poses: np.ndarray) -> bool:
    now = inverse(poses[edge.first]) @ poses[edge.second]
    apart_m, apart_rad = difference(now, edge.T_first_second)
    return apart_m > _SURPRISE_M or apart_rad > _SURPRISE_RAD
