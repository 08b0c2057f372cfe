"""Maps of the small room, for the tests of this folder."""

from functools import cache
from typing import Any

from hsslam_node.dense_map.dense_map import DenseMap
from hsslam_node.dense_map.keyframes import MapKeyframes, keyframes_of_store
from tests.small_room import SMALL, mapped_room


@cache
def room_map() -> DenseMap:
    """The map with all keyframes."""
    return map_of(keyframes_of_store(mapped_room().store))


def map_of(keyframes: MapKeyframes, **options: Any) -> DenseMap:
    """The room's field with these keyframes."""
    parameters = mapped_room().parameters
    params = parameters.published()[1]
    return DenseMap(parameters.layout, params, keyframes, SMALL.sampling, **options)
