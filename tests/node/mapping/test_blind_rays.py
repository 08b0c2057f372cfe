"""Pixels without depth: rays whose colour counts, if it has a weight."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.geometry.bound import Bound
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.map_optimiser import MapOptimiser
from hsslam_node.mapping.ray_batch import RayDraw, place_blind_rays, ray_batch
from hsslam_node.presets import PRESETS
from tests.small_room import SMALL, MappedRoom, mapped_room

RAYS = 600


def _half_blind(blind_color: float) -> MappedRoom:
    """The map, and one keyframe whose left half has no depth and another colour than the map."""
    weights = replace(SMALL.weights, blind_color=blind_color, patch=0.0, smoothness=0.0)
    room = mapped_room(replace(SMALL, weights=weights))
    frame = room.store.frame(0)
    depth, color = frame.depth_raw.copy(), frame.color.copy()
    depth[:, :80], color[:, :80] = 0, 255 - color[:, :80]
    store = KeyframeStore.create(MemoryAllocator(), frame.camera, frame.depth_units_per_m, 8)
    store.append(replace(frame, depth_raw=depth, color=color), room.store.pose(0))
    return replace(room, store=store)


def _step(room: MappedRoom, update: bool = True):
    optimiser = MapOptimiser(room.config, room.parameters, RAYS)
    poses = room.store.poses()
    keyframes, counts = np.array([0]), np.array([RAYS])
    return optimiser.step(
        room.store, keyframes, counts, poses, np.random.default_rng(1), update=update
    )


def test_pixels_without_depth_are_drawn_if_their_colour_counts():
    store = _half_blind(1.0).store
    for blind, share in ((False, 0.0), (True, 0.5)):
        batch = ray_batch(RAYS)
        draw = RayDraw(SMALL.mapper, blind=blind)
        R = draw.fill(batch, store, np.array([0]), np.array([RAYS]), np.random.default_rng(0))
        assert R == RAYS
        is_blind = batch.depth == 0
        assert is_blind.mean() == pytest.approx(share, abs=0.06)
        assert (batch.direction[is_blind, 0] < 0).all()  # the left half


def test_their_samples_reach_to_the_walls_of_the_bound():
    bound = Bound((-2.0, -1.0, -3.0), (2.0, 1.0, 4.0))
    batch = ray_batch(4)
    batch.direction[:] = [[0, 0, 1], [0.5, 0, 1], [0, 1, 1], [0, 0, 1]]
    batch.depth[:] = [0, 0, 0, 1.5]
    poses = np.stack([np.eye(4), np.eye(4)])
    poses[1, :3, 3] = [0.0, 0.5, 0.0]
    batch.slot[:] = [0, 0, 1, 1]
    place_blind_rays(batch, poses, bound)
    np.testing.assert_allclose(batch.depth, [-4.0, -4.0, -0.5, 1.5])
    poses[:, :3, 3] = [0.0, 0.0, 9.0]  # a camera outside
    batch.depth[:] = 0
    place_blind_rays(batch, poses, bound)
    assert (batch.depth < 0).all() and np.isfinite(batch.depth).all()


def test_their_colour_is_learned_and_nothing_else():
    """Where nothing was measured the map takes the colour that is seen there."""
    losses = {}
    for blind_color in (0.0, 1.0):
        room = _half_blind(blind_color)
        judge = _half_blind(1.0)
        for _ in range(30):
            _step(room)
        judge.parameters.params[:] = room.parameters.params
        losses[blind_color] = _step(judge, update=False).loss
    assert losses[1.0] < 0.7 * losses[0.0]


def test_the_weight_is_of_the_colour():
    whole, half, none = (
        _step(_half_blind(weight), update=False).loss for weight in (1.0, 0.5, 1e-6)
    )
    assert whole > 1.05 * none
    assert half - none == pytest.approx(0.5 * (whole - none), rel=1e-3)


def test_the_loss_of_a_keyframe_is_of_rays_with_depth():
    """So a sensor with holes is judged by the same threshold."""
    none, whole = (_step(_half_blind(w), update=False).keyframe_loss[0] for w in (1e-6, 1.0))
    assert whole == pytest.approx(none, rel=1e-6)


def test_publications_use_them_and_realtime_does_not():
    weights = {name: config.weights.blind_color for name, config in PRESETS.items()}
    assert weights == {"realtime": 0.0, "paper": 1.0, "eslam": 1.0, "co-slam": 1.0}
