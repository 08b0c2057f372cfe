"""The pose graph of two maps whose keyframes are in one store, those of the second map last."""

from collections.abc import Sequence

import numpy as np

from hsslam_node.bundle_adjustment.keyframe_alignment import KeyframeAlignment
from hsslam_node.bundle_adjustment.loop_search import LoopSearch
from hsslam_node.bundle_adjustment.pose_graph import PoseEdge, PoseEdges, solve_pose_graph
from hsslam_node.bundle_adjustment.tracked_chain import TrackedChain
from hsslam_node.config import SlamConfig
from hsslam_node.geometry.se3 import inverse
from hsslam_node.map.store import KeyframeStore
from hsslam_node.merging.meetings import Meeting
from hsslam_node.progress import Track, silently

_HELD_M, _HELD_RAD = 0.1, 0.05  # standard deviations of the edge that never counts as wrong
_BELIEVED = 0.5  # weight of an edge that the others confirm


class JoinedGraph:
    """The edges within each map, as bundle adjustment makes them, and the edges between the maps.

    Keyframe 0 never moves. The edge of the first meeting always holds the second map to the first, as
    loosely as meetings agree; all other edges between the maps may be wrong.

    Args:
        store: keyframes of both maps, the second's placed by the meetings.
        seam: id of the first keyframe of the second map.
    """

    def __init__(self, store: KeyframeStore, seam: int, config: SlamConfig, seed: int) -> None:
        self._store = store
        self._seam = seam
        self._config = config.pose_graph
        self._alignment = KeyframeAlignment(store, config.tracker, config.pose_graph, seed)
        self._loops = LoopSearch(store, self._alignment, config.tracker, config.pose_graph, seed)
        self._chain = TrackedChain(config.pose_graph)
        self._edges: list[PoseEdge] = []
        poses = store.poses()
        for k in range(1, len(poses)):
            if k != seam:
                T, gap = inverse(poses[k - 1]) @ poses[k], store.gap_covariance(k)
                self._edges += self._chain.add(k, T, gap)

    def solve(
        self, meetings: Sequence[Meeting], track: Track = silently
    ) -> tuple[np.ndarray, list[Meeting]]:
        """Poses [n, 4, 4] of all keyframes, and the meetings that they confirm.

        First the meetings place the maps, then each keyframe is aligned to those near it, in either map.
        """
        met = [(m, edge) for m in meetings if (edge := self._meeting_edge(m)) is not None]
        if not met:
            return self._store.poses(), []
        between = [edge for _, edge in met]
        poses, _ = self._solved(self._store.poses(), between)
        poses, weights = self._solved(poses, [*between, *self._near_edges(poses, track)])
        confirmed = zip(met, weights, strict=False)  # edges of meetings come first
        return poses, [meeting for (meeting, _), weight in confirmed if weight > _BELIEVED]

    def _meeting_edge(self, meeting: Meeting) -> PoseEdge | None:
        return self._alignment.loop(
            meeting.first, self._seam + meeting.second, meeting.T_first_second
        )

    def _near_edges(self, poses: np.ndarray, track: Track) -> list[PoseEdge]:
        """Edges to neighbours within a map, and to old keyframes or those of the other map nearby."""
        c = self._config
        edges: list[PoseEdge] = []
        newest_first = range(len(poses) - 1, 0, -c.aligned_every)
        for k in track(newest_first, description="keyframes"):
            oldest = self._seam if k >= self._seam else 0
            near = {
                gap: self._alignment.neighbour(k - gap, k, inverse(poses[k - gap]) @ poses[k])
                for gap in c.neighbours
                if k - gap >= oldest
            }
            aligned = {gap: edge for gap, edge in near.items() if edge is not None}
            self._chain.doubt(k, aligned)
            edges += [*aligned.values(), *self._loops.near(k, poses)]
        return edges

    def _solved(
        self, poses: np.ndarray, edges: Sequence[PoseEdge]
    ) -> tuple[np.ndarray, np.ndarray]:
        """The solved poses [n, 4, 4], and the weights of all edges, `edges` first."""
        n = len(poses)
        links = [k for k in range(1, n) if k != self._seam]
        held = np.diag(np.repeat([_HELD_M**-2, _HELD_RAD**-2], 3))
        first = edges[0]
        hold = PoseEdge(first.first, first.second, first.T_first_second, held, False)
        chain = self._chain.edges_to(np.array(links))
        graph = PoseEdges.of([*edges, *self._edges, *chain, hold])
        fixed = np.arange(n) == 0
        result = solve_pose_graph(poses, graph, fixed, kernel=self._config.kernel)
        return result.T_world_cam, result.weights
