"""Publication by stepped chunks is a full copy; readers can tell when their slot was overwritten."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.errors import OutOfMemoryError
from hsslam_node.geometry.bound import Bound
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.initialisation import initial_parameters
from hsslam_node.map.layout import FieldLayout
from hsslam_node.map.parameters import FieldParameters


@pytest.fixture
def arrays() -> MemoryAllocator:
    return MemoryAllocator()


@pytest.fixture
def parameters(arrays, layout) -> FieldParameters:
    return FieldParameters.create(arrays, layout, 3)


def _touch(parameters: FieldParameters, chunks: np.ndarray, value: float) -> None:
    """What Adam does to the chunks it steps."""
    parameters.params.reshape(-1, 16)[chunks] += value
    parameters.mark_stepped(chunks, parameters.count_step())


def test_new_parameters(parameters: FieldParameters, layout: FieldLayout):
    np.testing.assert_array_equal(parameters.params, initial_parameters(layout, 3))
    assert parameters.version == 0 and parameters.step == 0
    assert not parameters.first_moment.any() and not parameters.second_moment.any()
    assert parameters.layout == layout


touched = st.lists(st.lists(st.integers(0, 2**31), max_size=6), max_size=8)


@given(rounds=touched)
def test_publication_is_a_full_copy(layout, rounds):
    """Whatever was touched between publications, also nothing, also the same chunk again."""
    parameters = FieldParameters.create(MemoryAllocator(), layout, 0)
    chunks = len(parameters.stepped_at)
    for version, picks in enumerate(rounds, start=1):
        _touch(parameters, np.array(picks, np.int64) % chunks, 1.0)
        assert parameters.publish() == version
        now, published = parameters.published()
        assert now == version
        np.testing.assert_array_equal(published, parameters.params)


def test_publication_asks_only_marked_pages(parameters: FieldParameters):
    """A chunk that is said to have moved without its page is not looked at."""
    parameters.publish()
    parameters.publish()
    parameters.params[:] += 1.0
    parameters.mark_stepped(np.array([70]), parameters.count_step())
    parameters.stepped_at[200] = parameters.step
    parameters.publish()
    moved = (parameters.published()[1] == parameters.params).reshape(-1, 16).all(axis=1)
    assert np.flatnonzero(moved).tolist() == [70]


def test_a_published_map_does_not_move_with_the_parameters(parameters: FieldParameters):
    parameters.publish()
    _, published = parameters.published()
    before = published.copy()
    _touch(parameters, np.arange(10), 1.0)
    np.testing.assert_array_equal(published, before)
    parameters.publish()  # into the other slot
    np.testing.assert_array_equal(published, before)


def test_a_slot_is_intact_until_the_second_publication_after_it(parameters: FieldParameters):
    first = parameters.publish()
    assert parameters.is_intact(first)
    second = parameters.publish()
    assert parameters.is_intact(first) and parameters.is_intact(second)
    parameters.publish()
    assert not parameters.is_intact(first) and parameters.is_intact(second)


def test_a_publication_that_died_half_way_is_not_intact_and_heals(arrays, parameters):
    """The writer announced version 3 and died while it wrote into the slot of version 1."""
    parameters.publish()
    parameters.publish()
    state = arrays.open("field_state")
    begun = int(np.flatnonzero(state[:4] == 2)[-1])  # version and begun are both 2
    state[begun] = 3
    _touch(parameters, np.arange(5), 1.0)
    assert not parameters.is_intact(1) and parameters.is_intact(2)
    assert parameters.version == 2
    assert parameters.publish() == 3
    np.testing.assert_array_equal(parameters.published()[1], parameters.params)


def test_attachment_keeps_step_and_state(arrays, parameters: FieldParameters, layout):
    for step in range(1, 6):
        assert parameters.count_step() == step
    _touch(parameters, np.array([1, 7]), 2.0)
    parameters.first_moment[5] = 4.0
    parameters.publish()
    for other in (
        FieldParameters(arrays, layout.config),
        FieldParameters.create(arrays, layout, seed=99),  # a restarted mapper: not initialised anew
    ):
        assert other.step == 6 and other.version == 1 and other.layout == layout
        assert other.first_moment[5] == 4.0
        np.testing.assert_array_equal(other.params, parameters.params)
        np.testing.assert_array_equal(other.published()[1], parameters.params)
    assert FieldParameters(arrays, layout.config).count_step() == 7


def test_parameters_whose_maker_died_are_not_there_and_can_be_made_again(layout):
    arrays = MemoryAllocator()
    with pytest.raises(KeyError):
        FieldParameters(arrays, layout.config)
    arrays.create("field_state", (16,), np.int64)
    half = arrays.create("params", (layout.parameter_count,), np.float32)
    half[:100] = 7.0
    with pytest.raises(KeyError):
        FieldParameters(arrays, layout.config)
    parameters = FieldParameters.create(arrays, layout, 3)
    np.testing.assert_array_equal(parameters.params, initial_parameters(layout, 3))


WIDER = Bound((-2.0, -0.5, 0.2), (0.9, 1.5, 1.3))


def test_growth_keeps_what_was_learnt_and_goes_on(arrays, parameters: FieldParameters, layout):
    _touch(parameters, np.array([1, 7, 400]), 2.0)
    parameters.first_moment[:] = 4.0
    parameters.publish()
    _touch(parameters, np.array([3]), 1.0)
    before = {name: b.view(parameters.params).copy() for name, b in layout.blocks.items()}
    parameters.grow(WIDER, seed=5)
    assert parameters.layout == layout.grown(WIDER)
    assert parameters.version == 1 and parameters.step == 2
    blocks = parameters.layout.blocks
    for name in ("geometry_decoder.W1", "hash.15"):
        np.testing.assert_array_equal(blocks[name].view(parameters.params), before[name])
        assert (blocks[name].view(parameters.first_moment) == 4.0).all()
    moved = int((parameters.first_moment == 4.0).sum())
    assert moved == sum(block.size for block in layout.blocks.values())
    assert parameters.publish() == 2
    for version in (2, 3):
        now, published = parameters.published()
        assert now == version
        np.testing.assert_array_equal(published, parameters.params)
        _touch(parameters, np.array([11 + version]), 1.0)
        parameters.publish()


def test_readers_follow_a_growth_and_old_views_stay_as_they_were(arrays, parameters, layout):
    parameters.publish()
    reader = FieldParameters(arrays, layout.config)
    _, published = reader.published()
    before = published.copy()
    parameters.grow(WIDER, seed=5)
    _touch(parameters, np.arange(50), 1.0)
    parameters.publish()
    assert reader.layout == layout  # until it asks
    now, wider = reader.published()
    assert now == 2 and reader.layout == parameters.layout
    np.testing.assert_array_equal(wider, parameters.params)
    np.testing.assert_array_equal(published, before)
    assert not reader.follow()
    again = FieldParameters(arrays, layout.config)
    assert again.layout == parameters.layout
    np.testing.assert_array_equal(again.params, parameters.params)


class _Failing(MemoryAllocator):
    """Runs out of memory, or dies, at the given array."""

    def __init__(self) -> None:
        super().__init__()
        self.fails_at, self.error = "", OutOfMemoryError("full")

    def create(self, name, shape, dtype):
        if name == self.fails_at:
            raise self.error
        return super().create(name, shape, dtype)


@pytest.mark.parametrize("name", ["params.1", "adam_second.1", "published.1", "field_bound.1"])
@pytest.mark.parametrize("error", [OutOfMemoryError("full"), KeyboardInterrupt()])
def test_a_growth_that_fails_or_dies_half_way_leaves_the_map_as_it_was(layout, name, error):
    arrays = _Failing()
    parameters = FieldParameters.create(arrays, layout, 3)
    _touch(parameters, np.array([1, 7]), 2.0)
    parameters.publish()
    before = parameters.params.copy()
    arrays.fails_at, arrays.error = name, error
    with pytest.raises(type(error)):
        parameters.grow(WIDER, seed=5)
    restarted = FieldParameters.create(arrays, layout, 3)
    assert restarted.layout == layout and restarted.version == 1
    np.testing.assert_array_equal(restarted.params, before)
    assert restarted.publish() == 2
    arrays.fails_at = ""
    wider = Bound(WIDER.low, (2.0, 1.5, 1.3))  # another size than what was left behind
    restarted.grow(wider, seed=5)
    assert restarted.layout == layout.grown(wider)
    assert not arrays.exists("params") and arrays.exists("params.1")
