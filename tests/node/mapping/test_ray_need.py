"""Rays by need: what few pixels saw gets its share, holes get none."""

from dataclasses import replace

import numpy as np

from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.mapper import Mapper
from hsslam_node.mapping.ray_batch import RayDraw, ray_batch
from hsslam_node.mapping.ray_need import RayNeed
from tests.small_room import SMALL, empty_room, mapped_room, room_frames, room_poses


def _store(keyframes) -> KeyframeStore:
    first = room_frames()[0]
    store = KeyframeStore.create(MemoryAllocator(), first.camera, first.depth_units_per_m, 64)
    for frame, pose in keyframes:
        store.append(frame, pose)
    return store


def test_a_place_seen_once_is_looked_at_more_often_than_one_seen_in_all_others():
    first, last = (room_frames()[0], room_poses()[0]), (room_frames()[39], room_poses()[39])
    far = last[1].copy()
    far[:3, 3] += 30.0  # nothing in common with the others
    need = RayNeed(_store([first] * 9 + [(last[0], far)]), 12.0)
    rng = np.random.default_rng(0)
    chosen = np.concatenate([need.keyframes(2, rng) for _ in range(300)])
    share = np.bincount(chosen, minlength=10) / 300
    assert share[9] > 2 * share[:9].max()


def test_a_near_surface_does_not_take_most_of_the_rays():
    """Half of the image at 1 m, half at 4 m: the same number of rays a metre of surface, nearly."""
    frame = room_frames()[0]
    units = frame.depth_units_per_m
    depth = np.full(frame.depth_raw.shape, 1.0 * units, frame.depth_raw.dtype)
    depth[:, 80:] = 4.0 * units
    need = RayNeed(_store([(replace(frame, depth_raw=depth), np.eye(4))]), 12.0)
    u = need.pixels(0, 4000, np.random.default_rng(0))[:, 0]
    assert 0.6 < (u >= 80).mean() < 0.95  # of the area there are 16/17; uniform pixels: 1/2


def test_holes_and_what_is_too_far_get_no_rays():
    frame = room_frames()[0]
    depth = np.full(frame.depth_raw.shape, 2.0 * frame.depth_units_per_m, frame.depth_raw.dtype)
    depth[:, :64] = 0
    depth[:, 128:] = 13 * frame.depth_units_per_m if depth.max() < 5000 else 65535
    need = RayNeed(_store([(replace(frame, depth_raw=depth), np.eye(4))]), 12.0)
    uv = need.pixels(0, 1000, np.random.default_rng(0))
    assert (uv[:, 0] >= 60).all() and (uv[:, 0] < 132).all()
    assert (uv >= 0).all() and (uv[:, 1] < 120).all()


def test_draws_repeat_and_fill_the_batch():
    store = mapped_room().store
    need = RayNeed(store, 12.0)
    batches, draw = [], RayDraw(SMALL.mapper)
    for _ in range(2):
        batch = ray_batch(600)
        rng = np.random.default_rng(3)
        keyframes = need.keyframes(6, rng)
        assert len(set(keyframes.tolist())) == 6
        assert draw.fill(batch, store, keyframes, np.full(6, 100), rng, need) == 600
        batches.append(batch)
    np.testing.assert_array_equal(batches[0].direction, batches[1].direction)
    assert (batches[0].depth > 0).all()


def test_the_last_iterations_follow_new_keyframes():
    room = empty_room()
    mapper = Mapper(SMALL, room.parameters, 0)
    first = mapper.refine_sparse(room.store)
    room.store.append(room_frames()[39], room_poses()[39])
    second = mapper.refine_sparse(room.store)
    assert first.rays == second.rays == 10 * (SMALL.mapper.rays // 10) or first.rays > 0
    assert len(second.keyframe_loss) == 11
