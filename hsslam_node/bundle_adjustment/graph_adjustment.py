"""Keyframe poses by alignment of keyframes to each other, solved as a pose graph; the map follows."""

from contextlib import nullcontext
from dataclasses import replace
from functools import reduce

import numpy as np

from hsslam_node.bundle_adjustment.global_ba import GlobalBundleAdjustment
from hsslam_node.bundle_adjustment.keyframe_alignment import KeyframeAlignment, difference
from hsslam_node.bundle_adjustment.loop_search import LoopSearch
from hsslam_node.bundle_adjustment.pose_edges import PoseEdge, PoseEdges
from hsslam_node.bundle_adjustment.pose_graph import solve_pose_graph
from hsslam_node.bundle_adjustment.report import BaReport, Lease
from hsslam_node.config import SlamConfig
from hsslam_node.device.device import CPU, Device
from hsslam_node.field.parameters import FieldParameters
from hsslam_node.geometry.se3 import inverse
from hsslam_node.keyframes.store import KeyframeStore

_LOST_WEIGHT = 0.02  # edges that have faded below it are forgotten
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
        self._motions: list[np.ndarray] = []  # tracked, from each keyframe to the next
        self._seen = 1  # keyframes that have their edges
        self._all_at_next = False

    def is_due(self, store: KeyframeStore) -> bool:
        """Whether enough keyframes have come since the last round."""
        return self._map.is_due(store)

    def round(self, store: KeyframeStore, lease: Lease = nullcontext) -> BaReport:
        """Measure, solve, refine the map. `lease()` is held while the map is stepped, not before."""
        poses = store.poses()
        closed = self._measure(store, poses)
        solved = self._solved(poses)
        mapped = self._map.round(store, lease)
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

    def _measure(self, store: KeyframeStore, poses: np.ndarray) -> int:
        """Edges of the keyframes that are new; returns how many loops they close."""
        if self._alignment is None or self._loops is None:
            tracker, graph = self._slam.tracker, self._config
            self._alignment = KeyframeAlignment(store, tracker, graph, self._seed)
            self._loops = LoopSearch(store, self._alignment, tracker, graph, self._seed)
        count = len(poses)
        loops: list[PoseEdge] = []
        for k in range(self._seen, count):
            is_late = k < count - self._config.most_keyframes
            gaps = (1,) if is_late else self._config.neighbours
            near = [
                self._alignment.neighbour(k - gap, k, inverse(poses[k - gap]) @ poses[k])
                for gap in gaps
                if gap <= k
            ]
            self._edges += self._tracked(k, poses, near[0] if gaps[:1] == (1,) else None)
            self._edges += [edge for edge in near if edge is not None]
            if k % self._config.loop_every == 0 and not is_late:
                loops += self._loops.near(k, poses)
        if (
            count > self._seen
            and self._config.loops
            and not any(e.second >= count - self._config.loop_every for e in loops)
        ):
            loops += self._loops.alike(count - 1)
        self._seen = count
        self._edges += loops
        self._all_at_next |= any(_is_surprising(edge, poses) for edge in loops)
        return len(loops)

    def _tracked(self, k: int, poses: np.ndarray, aligned: PoseEdge | None) -> list[PoseEdge]:
        """The tracked motion since the keyframe before, and since one some way back."""
        c = self._config
        T = inverse(poses[k - 1]) @ poses[k]
        worse = 1.0
        if aligned is not None:  # it counts for less where that contradicts it, as after a jump
            apart_m, apart_rad = difference(T, aligned.T_first_second)
            worse = max(1.0, apart_m / c.odometry_sigma_m, apart_rad / c.odometry_sigma_rad)
        information = _information(worse * c.odometry_sigma_m, worse * c.odometry_sigma_rad)
        edges = [PoseEdge(k - 1, k, T, information, False)]
        self._motions.append(T)
        if len(self._motions) >= c.anchor_gap > 1:
            over = reduce(np.matmul, self._motions[-c.anchor_gap :])
            information = _information(c.anchor_sigma_m, c.anchor_sigma_rad)
            edges.append(PoseEdge(k - c.anchor_gap, k, over, information, True))
        return edges

    def _solved(self, poses: np.ndarray) -> np.ndarray:
        """All poses [n, 4, 4], the newest of them solved for; all, where a loop asks for it."""
        n = len(poses)
        oldest = 1 if self._all_at_next else max(1, n - self._config.window)
        fixed = np.arange(n) < oldest
        used = [i for i, e in enumerate(self._edges) if e.second >= oldest]
        edges = PoseEdges.of([self._edges[i] for i in used])
        result = solve_pose_graph(poses, edges, fixed, kernel=self._config.kernel)
        lost = {used[i] for i in np.flatnonzero(result.weights < _LOST_WEIGHT)}
        self._edges = [e for i, e in enumerate(self._edges) if i not in lost]
        self._all_at_next = False
        return result.T_world_cam


def _is_surprising(edge: PoseEdge, poses: np.ndarray) -> bool:
    now = inverse(poses[edge.first]) @ poses[edge.second]
    apart_m, apart_rad = difference(now, edge.T_first_second)
    return apart_m > _SURPRISE_M or apart_rad > _SURPRISE_RAD


def _information(sigma_m: float, sigma_rad: float) -> np.ndarray:
    return np.diag(np.repeat([sigma_m**-2, sigma_rad**-2], 3))
