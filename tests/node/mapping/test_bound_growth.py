"""The bound grows where a keyframe sees past it, and the map keeps what it knew."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.config import BoundConfig
from hsslam_node.errors import OutOfMemoryError
from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.camera import Camera
from hsslam_node.kernels.field.layout import kernel_layout
from hsslam_node.kernels.field.sdf_query import query_sdf
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.mapping.bound import wanted_bound
from hsslam_node.mapping.mapper import Mapper
from tests.small_room import SMALL, MappedRoom, mapped_room

CAMERA = Camera(160, 120, 100.0, 100.0, 80.0, 60.0)
BOX = Bound((-3.0, -1.2, -3.0), (3.0, 1.2, 3.0))


def _wanted(depth_m, position=(0.0, 0.0, 0.0), config=None, bound=BOX):
    T = np.eye(4)
    T[:3, 3] = position
    depth = np.full((120, 160), depth_m, np.float32)
    return wanted_bound(bound, depth, CAMERA, T, config or BoundConfig(), 12.0)


def test_a_keyframe_within_the_bound_asks_for_nothing():
    assert _wanted(1.5) is None
    assert _wanted(20.0) is None  # farther than what is mapped
    assert _wanted(0.0) is None  # no depth at all


def test_it_grows_past_what_is_seen_and_to_that_side_alone():
    wanted = _wanted(2.0, position=(0.0, 0.0, 2.0))
    assert wanted is not None
    assert wanted.high == pytest.approx((3.0, 1.2, 4.0 + 2.0))
    assert wanted.low == pytest.approx((-3.0, -1.2, -3.0))


def test_a_camera_outside_is_followed_even_without_depth():
    wanted = _wanted(0.0, position=(-4.0, 0.0, 0.0))
    assert wanted is not None and wanted.low[0] == pytest.approx(-6.0)


def test_a_few_far_outliers_do_not_grow_it():
    depth = np.full((120, 160), 1.5, np.float32)
    depth[::60, ::80] = 11.0
    assert wanted_bound(BOX, depth, CAMERA, np.eye(4), BoundConfig(), 12.0) is None


@given(x=st.floats(-200.0, 200.0), z=st.floats(-200.0, 200.0))
def test_it_never_shrinks_nor_passes_the_limit_and_settles(x, z):
    config = BoundConfig(farthest_m=20.0)
    wanted = _wanted(2.0, position=(x, 0.0, z), config=config)
    if wanted is None:
        return
    assert (np.array(wanted.low) <= BOX.low).all() and (np.array(wanted.high) >= BOX.high).all()
    assert np.abs([wanted.low, wanted.high]).max() <= 20.0
    assert _wanted(2.0, position=(x, 0.0, z), config=config, bound=wanted) is None


def _sdf(parameters: FieldParameters, points: np.ndarray) -> np.ndarray:
    sdf, inside = np.empty(len(points), np.float32), np.empty(len(points), np.uint8)
    query_sdf(
        parameters.params, kernel_layout(parameters.layout), points, sdf, inside,
        np.empty((0, 3), np.float32), False,
    )  # fmt: skip
    return sdf


def _with_a_far_keyframe(room: MappedRoom) -> Bound:
    """Append the last keyframe again, but 9 m away; returns the bound of before."""
    T = room.store.pose(9).copy()
    T[:3, 3] += (9.0, 0.0, 0.0)
    room.store.append(room.store.frame(9), T)
    return room.parameters.layout.bound


def test_the_map_grows_between_two_steps_and_keeps_what_it_knew():
    room = mapped_room()
    mapper = Mapper(SMALL, room.parameters, 0)
    assert mapper.grow_bound(room.store) is None  # all it has seen is within the bound
    mapper.iterate(room.store)
    old = _with_a_far_keyframe(room)
    low, extent = np.array(old.low), old.extent_m
    points = (low + np.random.default_rng(0).random((2000, 3)) * extent).astype(np.float32)
    before = _sdf(room.parameters, points)
    grown = mapper.grow_bound(room.store)
    assert grown is not None and grown.high[0] > old.high[0] + 3.0
    np.testing.assert_allclose(_sdf(room.parameters, points), before, atol=1e-6)
    assert mapper.grow_bound(room.store) is None
    reports = [mapper.iterate(room.store) for _ in range(30)]
    assert reports[-1].loss < reports[0].loss and reports[-1].outside == 0
    assert mapper.publish() == 2


def test_the_map_grows_to_keyframes_that_a_correction_has_moved_some_in_each_call():
    room = mapped_room()
    mapper = Mapper(SMALL, room.parameters, 0)
    for k in range(10):
        room.store.append(room.store.frame(k), room.store.pose(k))
    assert mapper.grow_bound(room.store) is None
    poses = room.store.poses()
    poses[2:, 0, 3] += 0.1  # within the margin
    room.store.correct_poses(np.arange(20), poses)
    assert mapper._take_uncovered(room.store) == []
    poses[2:, 0, 3] += 9.0
    room.store.correct_poses(np.arange(20), poses)
    grown = mapper.grow_bound(room.store)
    assert grown is not None and grown.contains(poses[2:, :3, 3]).all()
    assert mapper._take_uncovered(room.store) == [18, 19]


def test_another_stepper_goes_on_over_the_new_bound():
    """As the bundle adjustment's process does, which has attached before the growth."""
    room = mapped_room()
    mapper, other = Mapper(SMALL, room.parameters, 0), Mapper(SMALL, room.parameters, 1)
    other.iterate(room.store)
    _with_a_far_keyframe(room)
    mapper.grow_bound(room.store)
    assert other.iterate(room.store).outside == 0


@pytest.mark.parametrize("fixed", [{"grow": False}, {"box": (-3.0, -3.0, -3.0, 3.0, 3.0, 3.0)}])
def test_it_does_not_grow_where_that_is_switched_off_or_a_box_is_given(fixed):
    room = mapped_room()
    config = replace(SMALL, bound=replace(SMALL.bound, **fixed))
    mapper = Mapper(config, room.parameters, 0)
    old = _with_a_far_keyframe(room)
    assert mapper.grow_bound(room.store) is None and room.parameters.layout.bound == old


def test_without_memory_it_is_told_once_and_mapping_goes_on(monkeypatch):
    room = mapped_room()
    mapper = Mapper(SMALL, room.parameters, 0)
    old = _with_a_far_keyframe(room)

    def full(*_):
        raise OutOfMemoryError("no room")

    monkeypatch.setattr(room.parameters._arrays, "create", full)
    with pytest.raises(OutOfMemoryError):
        mapper.grow_bound(room.store)
    assert room.parameters.layout.bound == old
    _with_a_far_keyframe(room)
    assert mapper.grow_bound(room.store) is None
    assert np.isfinite(mapper.iterate(room.store).loss)
