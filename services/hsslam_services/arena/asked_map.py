"""The map of the run as clients ask it: their questions of places, answered from the newest version."""

import numpy as np

from hsslam_node.config import SlamConfig
from hsslam_node.dense_map.answers import MapAnswers
from hsslam_node.dense_map.dense_map import DenseMap
from hsslam_node.dense_map.keyframes import keyframes_of_store
from hsslam_node.dense_map.seen_space import SeenSpace
from hsslam_node.dense_map.snapshot import published_params
from hsslam_node.map.allocator import ArrayAllocator
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore
from hsslam_proto.point_codec import answers_message, question_points
from hsslam_proto.request_messages import PointAnswers, QueryMap, Refusal
from hsslam_services.arena.map_state import MapState
from hsslam_services.arena.shared_map import SharedMap


class AskedMap:
    """Answers questions of places; what keyframes saw is marked with the first question.

    One thread at a time asks.
    """

    def __init__(self, arrays: ArrayAllocator, config: SlamConfig, mode: MapState) -> None:
        self._config = config
        self._link = SharedMap(arrays, config)
        self._mode = mode
        self._seen = SeenSpace(config.field.truncation_m)

    def answer(self, question: QueryMap) -> PointAnswers | Refusal:
        """What the newest map says of the points; refused before there is one."""
        published = self._link.published()
        if published is None:
            return Refusal(reason="not_now", text="query: there is no map yet: expected keyframes")
        version, found = self._ask(*published, question_points(question))
        return answers_message(found, version, self._mode.map_epoch)

    def _ask(
        self, store: KeyframeStore, parameters: FieldParameters, points: np.ndarray
    ) -> tuple[int, MapAnswers]:
        """In place; if the map is overwritten meanwhile, as with many points, again in a copy."""
        keyframes, sampling = keyframes_of_store(store), self._config.sampling

        def ask(params: np.ndarray) -> MapAnswers:
            layout = parameters.layout
            return DenseMap(layout, params, keyframes, sampling, seen=self._seen).query(points)

        version, params = parameters.published()
        found = ask(params)
        if not parameters.is_intact(version):
            version, params = published_params(parameters)
            found = ask(params)
        return version, found
