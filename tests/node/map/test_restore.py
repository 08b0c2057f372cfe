"""A saved map made live again, and what cannot be."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hsslam_node.dense_map.snapshot import map_snapshot
from hsslam_node.errors import UserError
from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.pose_covariance import UNTRACKED
from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.inertial.gravity import Gravity
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.checkpoint import load_checkpoint, save_checkpoint
from hsslam_node.map.keyframes.world_frame import level_frame_in
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.restore import restore_map
from hsslam_node.map.store import KeyframeStore
from hsslam_node.meshing.map_queries import MapQueries
from tests.small_room import SMALL, MappedRoom, mapped_room

_LEVEL = RobotFrames.mounted((0.3, 0.1, 0.35, 0.1, 0.7, 0.1, 0.7)).T_base_cam


def _saved(path: Path, room: MappedRoom) -> Path:
    save_checkpoint(path, map_snapshot(room.store, room.parameters, SMALL))
    return path


@pytest.fixture(scope="module")
def room():
    room = mapped_room()
    room.store.world_frame.note_gravity(Gravity((0.0, -0.6, -0.8), 0.002))
    room.store.world_frame.note_level(_LEVEL)
    return room


@pytest.fixture(scope="module")
def path(room, tmp_path_factory):
    return _saved(tmp_path_factory.mktemp("map") / "room.safetensors", room)


def test_whoever_attaches_finds_the_map_as_it_was(room, path):
    arrays = MemoryAllocator()
    assert level_frame_in(arrays) is None
    restore_map(arrays, path, SMALL)
    store, parameters = KeyframeStore(arrays), FieldParameters(arrays, SMALL.field)
    assert store.count == store.inherited == room.store.count
    assert store.world_frame.gravity == Gravity((0.0, -0.6, -0.8), 0.002)
    store.world_frame.note_level(np.eye(4))  # of a robot that goes on in the map
    np.testing.assert_array_equal(store.world_frame.T_level_world, _LEVEL)
    np.testing.assert_array_equal(level_frame_in(arrays), _LEVEL)
    np.testing.assert_array_equal(store.poses(), room.store.poses())
    np.testing.assert_array_equal(store.stamps_ns(), room.store.stamps_ns())
    np.testing.assert_array_equal(store.pixels(2)[1], room.store.pixels(2)[1])
    assert (parameters.layout, parameters.step) == (room.parameters.layout, room.parameters.step)
    version, published = parameters.published()
    assert version == 1
    np.testing.assert_array_equal(published, room.parameters.published()[1])
    np.testing.assert_array_equal(parameters.params, published)
    moment = room.parameters.second_moment
    subnormal = np.finfo(np.float32).tiny  # has fewer bits
    np.testing.assert_allclose(parameters.second_moment, moment, rtol=2**-7, atol=subnormal)
    assert moment.max() > 0


def test_what_was_not_tracked_stays_unsure_also_between_keyframes_that_are_left(tmp_path):
    """Of five keyframes the fourth came after a gap, and is retired."""
    source = mapped_room().store
    first = source.frame(0)
    store = KeyframeStore.create(MemoryAllocator(), first.camera, first.depth_units_per_m, 8)
    for k in range(5):
        gap = UNTRACKED if k == 3 else np.zeros((6, 6))
        store.append(source.frame(k), source.pose(k), gap_covariance=gap)
    store.retire(3, 2)
    room = mapped_room()
    save_checkpoint(tmp_path / "m.safetensors", map_snapshot(store, room.parameters, SMALL))
    restored, _ = restore_map(MemoryAllocator(), tmp_path / "m.safetensors", SMALL)
    gaps = np.stack([restored.gap_covariance(k) for k in range(4)])  # of 0, 1, 2, 4
    assert not gaps[:3].any()
    np.testing.assert_allclose(
        gaps[3], UNTRACKED, atol=3e-4
    )  # turned, and with the lever of a step


def test_a_map_that_has_grown_may_grow_on(tmp_path):
    room = mapped_room()
    wider = room.parameters.layout.bound
    room.parameters.grow(Bound(wider.low, tuple(np.add(wider.high, 0.5))), 0)
    room.parameters.publish()
    arrays = MemoryAllocator()
    _, parameters = restore_map(arrays, _saved(tmp_path / "m.safetensors", room), SMALL)
    assert parameters.layout == room.parameters.layout
    np.testing.assert_array_equal(parameters.params, room.parameters.params)
    reader = FieldParameters(arrays, SMALL.field)
    parameters.grow(Bound(tuple(np.subtract(wider.low, 0.5)), wider.high), 0)
    parameters.publish()
    assert reader.published()[0] == 2
    assert reader.layout == parameters.layout != room.parameters.layout


def test_a_map_covers_the_box_that_is_configured_as_well(room, path):
    before = room.parameters.layout.bound
    box = (*np.subtract(before.low, 0.7).tolist(), *before.low)
    arrays = MemoryAllocator()
    _, parameters = restore_map(arrays, path, replace(SMALL, bound=replace(SMALL.bound, box=box)))
    bound = parameters.layout.bound
    assert bound.contains(np.array([box[:3], before.low, before.high])).all()
    assert FieldParameters(arrays, SMALL.field).published()[1].size == parameters.params.size
    point = np.array([[0.2, 0.1, 1.0]], np.float32)
    of_both = [
        MapQueries(p.layout, p.published()[1]).sdf(point) for p in (room.parameters, parameters)
    ]
    np.testing.assert_allclose(of_both[0], of_both[1], atol=1e-4)
    within = (*before.low, *before.high)
    config = replace(SMALL, bound=replace(SMALL.bound, box=within))
    assert restore_map(MemoryAllocator(), path, config)[1].layout == room.parameters.layout


def test_a_place_of_the_first_camera_is_refused_as_the_camera_is_found(path):
    first = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    bound = replace(SMALL.bound, box=(-1.0, -1.0, -1.0, 1.0, 1.0, 1.0), first_camera=first)
    with pytest.raises(UserError, match=r"bound\.first_camera = .*expected none with a saved map"):
        restore_map(MemoryAllocator(), path, replace(SMALL, bound=bound))


def test_a_map_of_another_field_is_refused(path):
    other = replace(SMALL, field=replace(SMALL.field, hash_table_log2=12))
    with pytest.raises(UserError, match=r"another field: field.hash_table_log2 is 13: expected 12"):
        restore_map(MemoryAllocator(), path, other)


def test_a_map_that_was_not_fitted_to_far_depth_is_refused_with_a_larger_limit(path, tmp_path):
    near = tmp_path / "near.safetensors"
    save_checkpoint(near, replace(load_checkpoint(path), max_depth_m=2.2))
    told = r"near\.safetensors: map of depth up to 2\.2 m: mapper\.max_depth_m is 12: expected at most 2\.2"
    with pytest.raises(UserError, match=told):
        restore_map(MemoryAllocator(), near, SMALL)
    nearer = replace(SMALL, mapper=replace(SMALL.mapper, max_depth_m=2.2))
    assert restore_map(MemoryAllocator(), near, nearer)[0].count == 10


def test_a_map_without_images_is_refused(path, tmp_path):
    old = replace(load_checkpoint(path), images=None, second_moment=None)
    save_checkpoint(tmp_path / "old.safetensors", old)
    with pytest.raises(UserError, match="holds no images of its keyframes"):
        restore_map(MemoryAllocator(), tmp_path / "old.safetensors", SMALL)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda m: {"T_world_keyframe": m.T_world_keyframe * np.nan}, "is no pose"),
        (lambda m: {"camera": m.camera.scaled(0.5)}, "px: expected 80x60"),
        (lambda m: {"images": replace(m.images, depth=0 * m.images.depth)}, "expected a PNG"),
    ],
)
def test_a_map_that_cannot_be_is_damaged(path, tmp_path, change, text):
    saved = load_checkpoint(path)
    save_checkpoint(tmp_path / "bad.safetensors", replace(saved, **change(saved)))
    with pytest.raises(UserError, match=f"damaged map: .*{text}"):
        restore_map(MemoryAllocator(), tmp_path / "bad.safetensors", SMALL)


def test_more_keyframes_than_fit_are_told(path):
    few = replace(SMALL, keyframes=replace(SMALL.keyframes, capacity=5))
    with pytest.raises(UserError, match=r"10 keyframes: expected fewer than .*capacity = 5"):
        restore_map(MemoryAllocator(), path, few)
