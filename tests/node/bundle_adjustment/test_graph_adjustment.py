"""Adjustment of keyframe poses as a graph: what it pulls back, what it leaves, and loops."""

import contextlib
from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.bundle_adjustment.graph_adjustment import GraphBundleAdjustment
from hsslam_node.bundle_adjustment.keyframe_alignment import KeyframeAlignment
from hsslam_node.bundle_adjustment.open_adjustment import open_adjustment
from hsslam_node.config import SlamConfig
from hsslam_node.geometry.se3 import inverse
from tests.small_room import (
    SMALL,
    MappedRoom,
    displaced,
    mapped_room,
    pose_error,
    room_frames,
    room_poses,
)

# images of 160 x 120 carry a sixteenth of the pixels that the deviations are meant for
_GRAPH = replace(SMALL.pose_graph, loop_gap=5, aligned_every=1, least_shift_m=1e-5)


def _config(**graph) -> SlamConfig:
    ba = replace(SMALL.ba, method="graph", iterations=1, every_keyframes=1, loss_threshold=1e6)
    return replace(SMALL, ba=ba, pose_graph=replace(_GRAPH, **graph))


def _adjusted(room: MappedRoom) -> np.ndarray:
    ba = GraphBundleAdjustment(room.config, room.parameters, 0)
    report = ba.round(room.store)
    room.store.correct_poses(report.keyframes, report.T_world_cam)
    return room.store.poses()


def _move(room: MappedRoom, k: int, distance_m: float, angle_deg: float) -> None:
    T = displaced(room.store.pose(k), distance_m, angle_deg, seed=k)
    room.store.correct_poses(np.array([k]), T[None])


def _errors(poses: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """[n, 2] m, degrees."""
    return np.array([pose_error(T, G) for T, G in zip(poses, truth, strict=True)])


@pytest.mark.parametrize(("k", "aligned_every"), [(3, 1), (6, 1), (9, 1), (3, 2), (6, 2), (9, 2)])
def test_a_displaced_keyframe_comes_back(k, aligned_every):
    room = mapped_room(_config(aligned_every=aligned_every))
    truth = room.store.poses()
    _move(room, k, 0.02, 1.0)
    assert pose_error(room.store.pose(k), truth[k]) == pytest.approx((0.02, 1.0), rel=0.01)
    errors = _errors(_adjusted(room), truth)
    assert errors[k, 0] < 0.002 and errors[k, 1] < 0.1
    assert errors[:, 0].max() < 0.003 and errors[:, 1].max() < 0.1  # nor do the others suffer


def test_the_first_keyframe_stays_even_if_it_is_the_one_displaced():
    room = mapped_room(_config())
    _move(room, 0, 0.02, 1.0)
    first, truth = room.store.pose(0), mapped_room().store.poses()
    poses = _adjusted(room)
    np.testing.assert_array_equal(poses[0], first)
    relative = inverse(truth[0]) @ truth
    errors = _errors(inverse(poses[0]) @ poses, relative)
    assert errors[:, 0].max() < 0.002


def test_what_a_round_leaves_is_done_by_the_next():
    room = mapped_room(_config(most_keyframes=5))
    truth = room.store.poses()
    _move(room, 2, 0.02, 1.0)
    ba = GraphBundleAdjustment(room.config, room.parameters, 0)
    errors_m = []
    while ba.is_behind(room.store):
        report = ba.round(room.store)
        room.store.correct_poses(report.keyframes, report.T_world_cam)
        errors_m.append(_errors(room.store.poses(), truth)[2, 0])
    assert len(errors_m) == 2  # ten keyframes, the newest first
    assert errors_m[0] > 0.01 and errors_m[1] < 0.002


def _drifted_return(config: SlamConfig, drift_m: float) -> tuple[MappedRoom, np.ndarray]:
    """Ten keyframes out, ten back to the start, the latter shifted more and more; and their truth."""
    room = mapped_room(config)
    frames, truth = room_frames(), room_poses()
    back = list(range(37, 0, -4))
    for step, k in enumerate(back):
        T = truth[k].copy()
        T[0, 3] += drift_m * (step + 1) / len(back)
        room.store.append(frames[k], T)
    return room, truth[[*range(0, 40, 4), *back]]


@pytest.mark.parametrize(
    ("terms", "most_m"),
    [({}, 0.004), ({"surface_weight": 0.0}, 0.015), ({"photometric_pixels": 0}, 0.004)],
)
def test_a_loop_takes_the_drift_away(terms, most_m):
    config = replace(_config(neighbours=(1,)), tracker=replace(SMALL.tracker, **terms))
    room, truth = _drifted_return(config, 0.04)
    before = _errors(room.store.poses(), truth)[:, 0].max()
    ba = GraphBundleAdjustment(room.config, room.parameters, 0)
    report = ba.round(room.store)
    assert before > 0.035 and len(report.loops) > 3 and report.moved
    room.store.correct_poses(report.keyframes, report.T_world_cam)
    assert _errors(room.store.poses(), truth)[:, 0].max() < most_m


def test_a_wrong_loop_does_no_harm(monkeypatch):
    room, truth = _drifted_return(_config(), 0.0)
    honest = KeyframeAlignment.loop
    lies = []

    def lying(self, first, second, T_first_second):
        edge = honest(self, first, second, T_first_second)
        if edge is not None and second % 4 == 0:
            lies.append(second)
            wrong = displaced(edge.T_first_second, 0.3, 5.0)
            return replace(edge, T_first_second=wrong)
        return edge

    monkeypatch.setattr(KeyframeAlignment, "loop", lying)
    assert _errors(_adjusted(room), truth)[:, 0].max() < 0.004 and lies


def test_keyframes_that_came_meanwhile_move_along():
    room, _ = _drifted_return(_config(neighbours=(1,)), 0.04)
    appended = []

    def lease():
        if not appended:
            appended.append(room.store.append(room_frames()[1], room.store.pose(19)))
        return np.errstate()

    ba = GraphBundleAdjustment(
        replace(room.config, ba=replace(room.config.ba, loss_threshold=1e-9)), room.parameters, 0
    )
    report = ba.round(room.store, lease)
    moved = room.store.correct_poses(report.keyframes, report.T_world_cam, report.known)
    assert appended == [20] and moved.keyframes[-1] == 20
    np.testing.assert_allclose(moved.T_world_cam[-1], moved.T_world_cam[-2], atol=1e-12)


def test_a_round_that_rests_is_the_same_and_holds_no_lease_meanwhile():
    reports, held, taken, rested = [], [], [], []

    @contextlib.contextmanager
    def lease():
        held.append(True)
        taken.append(True)
        yield
        held.pop()

    def rest():
        assert not held
        rested.append(bool(taken))

    for options in ({}, {"lease": lease, "rest": rest}):
        room, _ = _drifted_return(_config(neighbours=(1,)), 0.04)
        # every keyframe is one that the map renders badly: the map is stepped
        config = replace(room.config, ba=replace(room.config.ba, loss_threshold=1e-9))
        ba = GraphBundleAdjustment(config, room.parameters, 0)
        reports.append(ba.round(room.store, **options))
    np.testing.assert_array_equal(reports[0].T_world_cam, reports[1].T_world_cam)
    assert len(rested) > 10 and set(rested) == {False, True}  # keyframes, then steps of the map


def test_true_poses_stay_where_they_are():
    room = mapped_room(_config(least_shift_m=0.002))
    before = room.store.poses()
    ba = GraphBundleAdjustment(room.config, room.parameters, 0)
    assert not ba.round(room.store).moved
    np.testing.assert_array_equal(room.store.poses(), before)


def test_rounds_are_due_every_few_keyframes():
    room = mapped_room(_config())
    ba = open_adjustment(room.config, room.parameters, 0)
    assert isinstance(ba, GraphBundleAdjustment) and ba.is_due(room.store)
    ba.round(room.store)
    assert not ba.is_due(room.store)
    ba = open_adjustment(room.config, room.parameters, 0)
    room.store.mark_inherited()  # the run that saved the map has adjusted them
    assert not (ba.is_due(room.store) or ba.is_behind(room.store) or ba.has_joined(room.store))


def test_a_keyframe_that_is_only_turned_comes_back():
    room = mapped_room(_config(least_shift_m=0.01))
    right = room.store.pose(9)
    _move(room, 9, 0.0, 1.0)  # moves surfaces by 3 cm
    assert pose_error(_adjusted(room)[9], right)[1] < 0.2


def test_a_loop_that_moves_too_little_asks_for_all_poses_again():
    room, truth = _drifted_return(_config(neighbours=(1,), window=1, least_shift_m=10.0), 0.04)
    ba = GraphBundleAdjustment(room.config, room.parameters, 0)
    report = ba.round(room.store)
    assert report.loops and not report.moved
    ba._config = replace(ba._config, least_shift_m=1e-5)
    report = ba.round(room.store)
    assert len(report.keyframes) > 10  # with the window alone it is one
    room.store.correct_poses(report.keyframes, report.T_world_cam)
    assert _errors(room.store.poses(), truth)[:, 0].max() < 0.01


def test_what_mapping_refines_during_a_round_stays_beside_its_correction():
    room, refined = mapped_room(_config()), []
    _move(room, 6, 0.02, 1.0)
    then = room.store.poses()

    def rest():  # between two pieces of the round
        if not refined:
            _move(room, 3, 0.1, 5.0)
            refined.append(room.store.pose(3))

    report = GraphBundleAdjustment(room.config, room.parameters, 0).round(room.store, rest=rest)
    room.store.correct_poses(report.keyframes, report.T_world_cam, report.known, report.T_then)
    of_3 = report.T_world_cam[report.keyframes == 3][0]
    np.testing.assert_allclose(room.store.pose(3), refined[0] @ inverse(then[3]) @ of_3, atol=1e-12)
    of_6 = report.T_world_cam[report.keyframes == 6][0]
    np.testing.assert_array_equal(room.store.pose(6), of_6)


def test_keyframes_that_come_while_a_round_measures_are_left_to_the_next():
    room, came = mapped_room(_config()), []

    def rest():
        if not came:
            came.append(room.store.append(room_frames()[1], room.store.pose(9), fragment=1))

    ba = GraphBundleAdjustment(room.config, room.parameters, 0)
    ba.round(room.store, rest=rest)
    assert came == [10]
    assert ba.is_behind(room.store) and ba.is_due(room.store) and ba.has_joined(room.store)
    ba.round(room.store)
    assert not (ba.is_behind(room.store) or ba.has_joined(room.store))


def test_keyframes_of_a_restarted_tracker_are_no_fragment_that_has_joined():
    room = mapped_room(_config(most_keyframes=2))
    ba, store = GraphBundleAdjustment(room.config, room.parameters, 0), room.store
    ba.round(store)
    store.append(room_frames()[1], store.pose(9), fragment=1)
    assert ba.has_joined(store)
    ba.round(store)
    assert not ba.is_behind(store)  # all of the fragment, and what was left
    for frame in room_frames()[2:7]:
        store.append(frame, store.pose(9))
    assert not ba.has_joined(store)
    ba.round(store)
    assert ba.is_behind(store)  # three of five are left


def test_twice_the_same_to_the_bit():
    poses = []
    for _ in range(2):
        room, _truth = _drifted_return(_config(), 0.03)
        poses.append(_adjusted(room))
    np.testing.assert_array_equal(poses[0], poses[1])


def test_a_round_that_is_ended_moves_nothing_and_leaves_its_work_to_the_next():
    config = _config(loop_gap=5)
    room, truth = _drifted_return(config, 0.04)
    ba = GraphBundleAdjustment(
        replace(config, ba=replace(config.ba, loss_threshold=1e-9)), room.parameters, 0
    )
    step = room.parameters.step
    ended = ba.round(room.store, may_step=lambda: False)
    assert not ended.moved and ended.loops
    assert room.parameters.step == step
    report = ba.round(room.store)
    assert report.moved
    room.store.correct_poses(report.keyframes, report.T_world_cam)
    assert _errors(room.store.poses(), truth)[:, 0].max() < 0.02
