"""Converts arrays to the messages of the request `query` and back."""

import numpy as np

from hsslam_node.dense_map.answers import MapAnswers
from hsslam_proto.request_messages import PointAnswers, QueryMap


def question_message(points: np.ndarray) -> QueryMap:
    """The request for points [N, 3] m.

    Raises:
        ValueError: more points than one request may have.
    """
    return QueryMap(points=_bytes(points, "<f4"))


def question_points(message: QueryMap) -> np.ndarray:
    """The points [N, 3] float32 m of a request."""
    return np.frombuffer(message.points, "<f4").reshape(-1, 3)


def answers_message(answers: MapAnswers, map_version: int, map_epoch: int) -> PointAnswers:
    """The message of answers from this version of the map."""
    return PointAnswers(
        count=len(answers.distance_m),
        distance_m=_bytes(answers.distance_m, "<f4"),
        gradient=_bytes(answers.gradient, "<f4"),
        known=_bytes(answers.known, "u1"),
        certainty=_bytes(answers.certainty, "<f4"),
        map_version=map_version,
        map_epoch=map_epoch,
    )


def answers_of(message: PointAnswers) -> MapAnswers:
    """The answers in a message."""
    return MapAnswers(
        distance_m=np.frombuffer(message.distance_m, "<f4"),
        gradient=np.frombuffer(message.gradient, "<f4").reshape(-1, 3),
        known=np.frombuffer(message.known, "u1").astype(np.bool_),
        certainty=np.frombuffer(message.certainty, "<f4"),
    )


def _bytes(array: np.ndarray, dtype: str) -> memoryview:
    flat = np.ascontiguousarray(array, dtype).reshape(-1)  # a memoryview has no sides of length 0
    return flat.view(np.uint8).data
