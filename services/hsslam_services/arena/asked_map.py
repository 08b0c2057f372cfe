"""Answers clients' queries of points from the newest map."""

from collections.abc import Callable

import numpy as np

from hsslam_node.config import SlamConfig
from hsslam_node.dense_map.answers import MapAnswers
from hsslam_node.dense_map.dense_map import DenseMap
from hsslam_node.dense_map.keyframes import MapKeyframes, keyframes_of_store
from hsslam_node.dense_map.seen_places import MOST_CELLS, SeenPlaces
from hsslam_node.dense_map.seen_space import SeenCells
from hsslam_node.dense_map.shapes import finite_rows
from hsslam_node.dense_map.snapshot import published_params
from hsslam_node.map.allocator import ArrayAllocator
from hsslam_node.map.parameters import FieldParameters
from hsslam_proto.point_codec import answers_message, question_points
from hsslam_proto.request_messages import PointAnswers, QueryMap, Refusal
from hsslam_services.arena.map_state import MapState
from hsslam_services.arena.shared_map import SharedMap

_WITHIN_S = 8.0  # of the 15 s that a query may take


class AskedMap:
    """Answers queries of points; not thread-safe.

    The first query starts to mark the space that the keyframes saw. If this takes longer than a query
    may, the next query goes on with it.

    Args:
        report: takes a line for the operator, when the map gets more than `most_cells` cells of 5 cm.
    """

    def __init__(
        self,
        arrays: ArrayAllocator,
        config: SlamConfig,
        mode: MapState,
        report: Callable[[str], None],
        most_cells: int = MOST_CELLS,
    ) -> None:
        self._config = config
        self._link = SharedMap(arrays, config)
        self._mode = mode
        reach_m, max_depth_m = config.field.truncation_m, config.mapper.max_depth_m
        self._seen = SeenPlaces(reach_m, max_depth_m, report, most_cells)

    def answer(self, question: QueryMap) -> PointAnswers | Refusal:
        """Query the newest map; a `Refusal` before there is a map, or while keyframes are unprocessed."""
        published = self._link.published()
        if published is None:
            return Refusal(reason="not_now", text="query: there is no map yet: expected keyframes")
        points, keyframes = question_points(question), keyframes_of_store(published[0])
        seen = self._seen.follow_for(keyframes, finite_rows("points", points, 3), _WITHIN_S)
        if isinstance(seen, int):
            text = f"query: {seen} of {len(keyframes)} keyframes are not processed yet: ask again"
            return Refusal(reason="unfinished", text=text)
        version, found = self._ask(keyframes, seen, published[1], points)
        return answers_message(found, version, self._mode.map_epoch)

    def _ask(
        self,
        keyframes: MapKeyframes,
        seen: SeenCells,
        parameters: FieldParameters,
        points: np.ndarray,
    ) -> tuple[int, MapAnswers]:
        """Query the shared parameters; if the mapper overwrites them meanwhile, query a copy."""

        def ask(params: np.ndarray) -> MapAnswers:
            layout = parameters.layout  # `published()` may have changed it
            asked = DenseMap(layout, params, keyframes, self._config.sampling, seen=lambda: seen)
            return asked.query(points)

        version, params = parameters.published()
        found = ask(params)
        if not parameters.is_intact(version):
            version, params = published_params(parameters)
            found = ask(params)
        return version, found
