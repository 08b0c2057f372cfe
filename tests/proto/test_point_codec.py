import numpy as np
import pytest

from hsslam_node.dense_map.answers import MapAnswers
from hsslam_proto.codec import Rejected, decode, encode, encoding_of
from hsslam_proto.point_codec import (
    answers_message,
    answers_of,
    question_message,
    question_points,
)
from hsslam_proto.request_messages import MOST_POINTS, PointAnswers, QueryMap
from hsslam_proto.requests import QUERY


def _crossed(payload, message):
    found = decode(payload, encode(payload, message), encoding_of(payload))
    assert not isinstance(found, Rejected), found
    return found


@pytest.mark.parametrize("count", [0, 1, 7, MOST_POINTS])
def test_points_and_answers_cross_the_wire(count):
    rng = np.random.default_rng(count)
    points = rng.normal(size=(count, 3)).astype(np.float32)
    np.testing.assert_array_equal(
        question_points(_crossed(QUERY.asked, question_message(points))), points
    )
    answers = MapAnswers(
        rng.normal(size=count).astype(np.float32),
        rng.normal(size=(count, 3)).astype(np.float32),
        rng.random(count) < 0.5,
        rng.random(count).astype(np.float32),
    )
    message = _crossed(QUERY.answered, answers_message(answers, 7, 2))
    assert (message.count, message.map_version, message.map_epoch) == (count, 7, 2)
    for sent, came in zip(answers, answers_of(message), strict=True):
        np.testing.assert_array_equal(sent, came)
        assert sent.dtype == came.dtype


def test_the_bytes_are_what_the_document_says():
    message = question_message(np.array([[1.0, 2.0, 3.0]]))
    assert bytes(message.points) == bytes.fromhex("0000803f 00000040 00004040")


@pytest.mark.parametrize("nbytes", [11, 13, 12 * MOST_POINTS + 12])
def test_a_question_of_another_size_is_refused(nbytes):
    with pytest.raises(ValueError, match=f"points has {nbytes} bytes: expected 12 a point"):
        QueryMap(points=memoryview(bytes(nbytes)))
    sent = b"\x81\xa6points\xc6" + nbytes.to_bytes(4, "big") + bytes(nbytes)
    refused = decode(QUERY.asked, sent, encoding_of(QUERY.asked))
    assert isinstance(refused, Rejected) and refused.reason == "malformed"


def test_answers_that_do_not_fit_their_count_are_refused():
    part = memoryview(bytes(4))
    with pytest.raises(ValueError, match="gradient has 4 bytes: expected 12"):
        PointAnswers(
            count=1, distance_m=part, gradient=part, known=part[:1], certainty=part, map_version=1
        )
