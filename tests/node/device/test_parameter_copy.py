"""Copies of the parameters follow chunk by chunk and bring back what was stepped: always as if all
of it had been copied."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.config import FieldConfig
from hsslam_node.device.device import Device
from hsslam_node.device.parameter_copy import ParameterCopy, PublishedCopy
from hsslam_node.geometry.bound import Bound
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.layout import FieldLayout
from hsslam_node.map.parameters import FieldParameters

INTERPRETER = Device("interpreter", "test", "test")
TINY = replace(FieldConfig(plane_channels=16), hash_levels=2, hash_table_log2=8)
LAYOUT = FieldLayout.over(TINY, Bound((0.0, 0.0, 0.0), (0.5, 0.5, 0.5)))


def _step_on_host(parameters: FieldParameters, chunks: np.ndarray, value: float) -> None:
    """What Adam does to the chunks it steps."""
    arrays = parameters.params, parameters.first_moment, parameters.second_moment
    for k, array in enumerate(arrays):
        array.reshape(-1, 16)[chunks] += value + k
    parameters.mark_stepped(chunks, parameters.count_step())


def _step_on_device(copy: ParameterCopy, chunks: np.ndarray, value: float) -> None:
    copy.pull()
    step = copy.count_step()
    for k, array in enumerate((copy.params, copy.first_moment, copy.second_moment)):
        array.view(-1, 16)[torch.from_numpy(chunks)] += value + k
    copy.stepped_at[torch.from_numpy(chunks)] = step


turns = st.lists(
    st.tuples(st.sampled_from(["host", "a", "b"]), st.lists(st.integers(0, 2**31), max_size=5)),
    max_size=10,
)


@given(turns=turns)
def test_steppers_that_take_turns_see_each_others_steps(turns):
    """Host, two device copies, in any order, also nothing stepped, also the same chunk again."""
    parameters = FieldParameters.create(MemoryAllocator(), LAYOUT, 0)
    mirror = FieldParameters.create(MemoryAllocator(), LAYOUT, 0)
    copies = {name: ParameterCopy(parameters, INTERPRETER) for name in "ab"}
    reader = PublishedCopy(parameters, INTERPRETER, LAYOUT.geometry_count)
    for turn, (who, picks) in enumerate(turns):
        chunks = np.unique(np.array(picks, np.int64) % len(parameters.stepped_at))
        _step_on_host(mirror, chunks, 0.5 + turn)
        if who == "host":
            _step_on_host(parameters, chunks, 0.5 + turn)
        else:
            _step_on_device(copies[who], chunks, 0.5 + turn)
            copies[who].push()
        _expect_equal(parameters, mirror)
        if turn % 3 == 1:
            reader.pull()
        if turn % 2 == 1:
            parameters.publish()
    version = parameters.publish()
    assert reader.pull() == version
    np.testing.assert_array_equal(reader.params.numpy(), mirror.params[: LAYOUT.geometry_count])


@pytest.mark.parametrize("most_chunks", [1 << 16, 7], ids=["at once", "in parts"])
def test_a_new_copy_takes_everything(monkeypatch, most_chunks):
    monkeypatch.setattr("hsslam_node.device.parameter_copy._MOST_CHUNKS", most_chunks)
    parameters = FieldParameters.create(MemoryAllocator(), LAYOUT, 3)
    _step_on_host(parameters, np.array([1, 5]), 1.0)
    copy = ParameterCopy(parameters, INTERPRETER)
    copy.pull()
    np.testing.assert_array_equal(copy.params.numpy(), parameters.params)
    np.testing.assert_array_equal(copy.first_moment.numpy(), parameters.first_moment)
    np.testing.assert_array_equal(copy.second_moment.numpy(), parameters.second_moment)
    before = parameters.params.copy()
    _step_on_device(copy, np.arange(len(parameters.stepped_at)), 1.0)
    copy.push()
    np.testing.assert_array_equal(parameters.params, before + 1.0)


def test_steps_on_the_device_are_published_and_reach_cpu_steppers():
    parameters = FieldParameters.create(MemoryAllocator(), LAYOUT, 3)
    copy = ParameterCopy(parameters, INTERPRETER)
    for _ in range(3):
        _step_on_device(copy, np.array([2, 9]), 1.0)
    assert parameters.step == 3
    copy.push()
    assert np.flatnonzero(parameters.stepped_at == 3).tolist() == [2, 9]
    parameters.publish()
    np.testing.assert_array_equal(parameters.published()[1], copy.params.numpy())


def _expect_equal(parameters: FieldParameters, mirror: FieldParameters) -> None:
    np.testing.assert_array_equal(parameters.params, mirror.params)
    np.testing.assert_array_equal(parameters.first_moment, mirror.first_moment)
    np.testing.assert_array_equal(parameters.second_moment, mirror.second_moment)
    np.testing.assert_array_equal(parameters.stepped_at, mirror.stepped_at)
