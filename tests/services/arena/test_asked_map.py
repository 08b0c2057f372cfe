"""Questions of places, answered from the map as it is published."""

import numpy as np
import pytest

from hsslam_node.dense_map.dense_map import DenseMap
from hsslam_node.dense_map.keyframes import keyframes_of_store
from hsslam_node.errors import UserError
from hsslam_node.geometry.bound import Bound
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.parameters import FieldParameters
from hsslam_proto.point_codec import answers_of, question_message
from hsslam_proto.request_messages import PointAnswers, Refusal
from hsslam_services.arena import asked_map
from hsslam_services.arena.asked_map import AskedMap
from hsslam_services.arena.map_state import MapState
from tests.small_room import SMALL, mapped_room

POINTS = np.random.default_rng(0).uniform((-1, -1, 0.5), (1, 1, 3), (500, 3)).astype(np.float32)


@pytest.fixture
def mode(tmp_path, monkeypatch: pytest.MonkeyPatch) -> MapState:
    monkeypatch.setattr(asked_map, "_WITHIN_S", 600.0)  # on a busy machine, too
    return MapState.create(tmp_path, localise_only=False)


def test_the_answer_is_that_of_the_newest_map(mode):
    room = mapped_room()
    asked = AskedMap(room.arrays, SMALL, mode, print)
    mode.map_epoch = 3
    versions = []
    for _ in range(2):
        told = asked.answer(question_message(POINTS))
        assert isinstance(told, PointAnswers) and told.map_epoch == 3
        versions.append(told.map_version)
        params = room.parameters.published()[1]
        keyframes = keyframes_of_store(room.store)
        of_library = DenseMap(room.parameters.layout, params, keyframes, SMALL.sampling)
        for ours, theirs in zip(answers_of(told), of_library.query(POINTS), strict=True):
            np.testing.assert_array_equal(ours, theirs)
        room.parameters.params[:] += 0.01
        room.parameters.mark_stepped(
            np.arange(len(room.parameters.stepped_at)), room.parameters.count_step()
        )
        room.parameters.publish()
    assert versions == [1, 2]


def test_a_question_after_the_map_has_grown_is_answered_from_the_grown_one(mode):
    room = mapped_room()
    asked = AskedMap(room.arrays, SMALL, mode, print)
    before = answers_of(asked.answer(question_message(POINTS)))
    grown = FieldParameters(room.arrays, SMALL.field)  # as the mapper has it
    bound = grown.layout.bound
    grown.grow(Bound.of(np.array(bound.low) - 1.0, np.array(bound.high) + 1.0), 0)
    grown.publish()
    first, second = (answers_of(asked.answer(question_message(POINTS))) for _ in range(2))
    for ours, theirs in zip(first, second, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert np.count_nonzero(before[2]) == np.count_nonzero(first[2]) > 100


def test_before_a_map_is_published_it_is_refused(mode):
    asked = AskedMap(MemoryAllocator(), SMALL, mode, print)
    told = asked.answer(question_message(POINTS))
    assert isinstance(told, Refusal) and told.reason == "not_now"
    assert told.text == "query: there is no map yet: expected keyframes"


def test_a_question_that_takes_too_long_is_gone_on_with(mode, monkeypatch):
    monkeypatch.setattr(asked_map, "_WITHIN_S", 0.0)
    room = mapped_room()
    asked, count = AskedMap(room.arrays, SMALL, mode, print), len(room.store.kept())
    for left in range(count - 1, 0, -1):
        told = asked.answer(question_message(POINTS))
        assert isinstance(told, Refusal) and told.reason == "unfinished"
        assert told.text.startswith(f"query: {left} of {count} keyframes are not processed yet")
    assert isinstance(asked.answer(question_message(POINTS)), PointAnswers)


def test_points_that_are_not_finite_are_bad_input(mode):
    asked = AskedMap(mapped_room().arrays, SMALL, mode, print)
    with pytest.raises(UserError, match=r"points .*nan.*: expected finite numbers"):
        asked.answer(question_message(np.array([[0.0, np.nan, 0.0]])))


def test_a_map_of_too_many_cells_is_reported_once_and_points_too_far_apart_are_refused(mode):
    told: list[str] = []
    asked = AskedMap(mapped_room().arrays, SMALL, mode, told.append, most_cells=1000)
    for _ in range(2):
        with pytest.raises(UserError, match=r"points are up to 4 m apart: .* more than 1000 cells"):
            asked.answer(question_message(POINTS))
    assert [text.split(":")[1] for text in told] == [" the map has more than 1000 cells of 0.05 m"]
