"""Global bundle adjustment: pose gradients, what is chosen, what moves, and that it helps."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.bundle_adjustment.global_ba import GlobalBundleAdjustment
from hsslam_node.config import BundleAdjustmentConfig, SlamConfig
from hsslam_node.geometry.se3 import moved_about_camera
from hsslam_node.mapping.map_optimiser import MapOptimiser
from tests.small_room import SMALL, MappedRoom, displaced, mapped_room, pose_error

BA = BundleAdjustmentConfig(
    rays=1000, iterations=10, pose_rate=1e-3, probe_rays=100, probe_keyframes=10,
    loss_threshold=1e-6, cooldown_rounds=0,
)  # fmt: skip


def _config(**ba) -> SlamConfig:
    return replace(SMALL, ba=replace(BA, **ba))


def _room(displaced_keyframe: int | None = None, **ba) -> MappedRoom:
    room = mapped_room(_config(**ba))
    if displaced_keyframe is not None:
        k = displaced_keyframe
        room.store.correct_poses(np.array([k]), displaced(room.store.pose(k), 0.02, 1.0)[None])
    return room


def _ba(room: MappedRoom) -> GlobalBundleAdjustment:
    return GlobalBundleAdjustment(room.config, room.parameters, 0)


def test_pose_gradient_is_the_slope_of_the_loss_for_every_keyframe():
    config = replace(SMALL, weights=replace(SMALL.weights, patch=0.0, smoothness=0.0))
    room = mapped_room(config)
    keyframes = np.array([0, 3, 6, 8])
    counts = np.full(4, 400)
    optimiser = MapOptimiser(config, room.parameters, 1600)
    poses = np.stack([displaced(room.store.pose(k), 0.01, 0.5, seed=k) for k in keyframes])

    def loss(slot: int, step: np.ndarray) -> float:
        moved = poses.copy()
        moved[slot] = moved_about_camera(moved[slot], step)
        generator = np.random.default_rng(5)
        return optimiser.step(room.store, keyframes, counts, moved, generator, update=False).loss

    slopes = np.zeros((4, 6))
    for slot, axis in np.ndindex(4, 6):
        step = np.zeros(6)
        step[axis] = 1e-4
        slopes[slot, axis] = (loss(slot, step) - loss(slot, -step)) / 2e-4
    report = optimiser.step(
        room.store, keyframes, counts, poses, np.random.default_rng(5), with_poses=True
    )
    assert (np.abs(report.pose_gradient) > 0).all()
    for got, slope in zip(report.pose_gradient, slopes, strict=True):
        for part in (slice(0, 3), slice(3, 6)):
            assert np.linalg.norm(got[part] - slope[part]) < 0.05 * np.linalg.norm(slope[part])


def test_a_probe_changes_nothing():
    room = mapped_room()
    before, step = room.parameters.params.copy(), room.parameters.step
    optimiser = MapOptimiser(SMALL, room.parameters, 200)
    keyframes, counts = np.array([1, 2]), np.array([100, 100])
    poses = room.store.poses()[keyframes]
    report = optimiser.step(
        room.store, keyframes, counts, poses, np.random.default_rng(0), update=False
    )
    assert report.rays == 200 and (report.keyframe_loss > 0).all()
    assert not report.pose_gradient.any()
    np.testing.assert_array_equal(room.parameters.params, before)
    assert room.parameters.step == step


def test_a_displaced_keyframe_is_chosen_and_pulled_back():
    room = _room(displaced_keyframe=6, top_keyframes=3)
    truth = mapped_room().store.poses()
    ba = _ba(room)
    errors = [pose_error(room.store.pose(6), truth[6])]
    for _ in range(20):
        report = ba.round(room.store)
        if len(errors) == 1:
            assert report.keyframes[0] == 6  # the worst comes first
        assert report.moved
        room.store.correct_poses(report.keyframes, report.T_world_cam)
        errors.append(pose_error(room.store.pose(6), truth[6]))
    assert errors[0] == pytest.approx((0.02, 1.0), rel=0.01)
    assert errors[-1][0] < 0.006 and errors[-1][1] < 0.2
    others = [pose_error(room.store.pose(k), truth[k]) for k in range(10) if k != 6]
    assert max(distance for distance, _ in others) < 0.01


def test_the_first_keyframe_never_moves():
    room = _room(displaced_keyframe=0)
    before = room.store.pose(0)
    report = _ba(room).round(room.store)
    assert 0 in report.keyframes and report.moved
    at = int(np.flatnonzero(report.keyframes == 0)[0])
    np.testing.assert_array_equal(report.T_world_cam[at], before)
    others = np.delete(report.T_world_cam, at, axis=0)
    assert (others != room.store.poses()[np.delete(report.keyframes, at)]).any(axis=(1, 2)).all()


def test_below_the_threshold_nothing_happens():
    room = _room(loss_threshold=1e6)
    before, step = room.parameters.params.copy(), room.parameters.step
    report = _ba(room).round(room.store)
    assert len(report.keyframes) == 0 and not report.moved
    assert room.parameters.step == step
    np.testing.assert_array_equal(room.parameters.params, before)


def test_refined_keyframes_rest():
    room = _room(top_keyframes=4, cooldown_rounds=1, iterations=1)
    ba = _ba(room)
    first, second = (set(ba.round(room.store).keyframes.tolist()) for _ in range(2))
    assert len(first) == len(second) == 4 and not first & second


def test_without_a_pose_rate_only_the_map_is_refined():
    room = _room(pose_rate=0.0)
    step = room.parameters.step
    report = _ba(room).round(room.store)
    assert not report.moved and room.parameters.step == step + 10
    np.testing.assert_array_equal(report.T_world_cam, room.store.poses()[report.keyframes])


def test_a_round_lowers_the_loss_of_its_keyframes():
    room = _room(displaced_keyframe=6, top_keyframes=3, iterations=20)
    report = _ba(room).round(room.store)
    assert report.loss_after < 0.7 * report.loss_before


def test_uniform_selection_takes_random_keyframes_whatever_their_loss():
    room = _room(selection="uniform", loss_threshold=1e6, top_keyframes=4, iterations=2)
    ba = _ba(room)
    reports = [ba.round(room.store) for _ in range(4)]
    chosen = [set(r.keyframes.tolist()) for r in reports]
    assert all(len(c) == 4 for c in chosen) and len(set.union(*chosen)) > 6
    for r in reports:
        assert r.moved and 0 < r.loss_before < 1 and 0 < r.loss_after < 1


def test_uniform_selection_pulls_a_displaced_keyframe_back():
    room = _room(displaced_keyframe=6, selection="uniform", top_keyframes=512)
    truth = mapped_room().store.poses()
    ba = _ba(room)
    for _ in range(10):
        report = ba.round(room.store)
        assert report.keyframes.tolist() == list(range(10))
        room.store.correct_poses(report.keyframes, report.T_world_cam)
    distance_m, angle_deg = pose_error(room.store.pose(6), truth[6])
    assert distance_m < 0.01 and angle_deg < 0.5


def test_rounds_are_due_every_few_keyframes():
    room = _room(every_keyframes=4)
    ba = _ba(room)
    assert ba.is_due(room.store)
    room.store.mark_inherited()  # the run that saved the map has adjusted them
    assert not ba.is_due(room.store) and not ba.is_behind(room.store)
    ba.round(room.store)
    assert not ba.is_due(room.store)
    for _ in range(4):
        assert not ba.is_due(room.store)
        room.store.append(room.store.frame(9), room.store.pose(9))
    assert ba.is_due(room.store)


def test_the_same_seed_gives_the_same_correction_to_the_bit():
    reports = []
    for _ in range(2):
        room = _room(displaced_keyframe=6, iterations=3)
        reports.append(_ba(room).round(room.store))
    np.testing.assert_array_equal(reports[0].keyframes, reports[1].keyframes)
    np.testing.assert_array_equal(reports[0].T_world_cam, reports[1].T_world_cam)


def test_a_round_ends_at_the_step_before_which_it_is_told_to():
    room = _room(displaced_keyframe=6, iterations=10)
    poses, step = room.store.poses(), room.parameters.step
    left = iter([True, True, True, False])
    report = _ba(room).round(room.store, may_step=lambda: next(left))
    assert room.parameters.step == step + 3 and list(left) == []
    assert not report.moved and len(report.keyframes) == 0
    np.testing.assert_array_equal(room.store.poses(), poses)
