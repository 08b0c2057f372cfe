"""A correction reaches the keyframes and, as a message, everybody else."""

import numpy as np

from hsslam_proto.messages import Correction
from hsslam_proto.pose_codec import pose_matrix, wire_pose
from hsslam_services.arena import pose_corrector
from hsslam_services.arena.map_state import MapState
from hsslam_services.arena.pose_corrector import PoseCorrector
from tests.small_room import displaced, mapped_room


class _Heard:
    def __init__(self) -> None:
        self.messages: list[Correction] = []

    def put(self, message: Correction, /) -> None:
        self.messages.append(message)


def test_a_correction_is_written_and_told(tmp_path):
    store, heard = mapped_room().store, _Heard()
    state = MapState.create(tmp_path, localise_only=False)
    state.map_epoch = 2
    corrector = PoseCorrector(heard, state)
    ids = np.array([3, 6])
    wanted = np.stack([displaced(store.pose(int(k)), 0.02, 1.0) for k in ids])
    corrector.correct(store, ids, wanted, store.count, (0.5, 0.25), [(8, 1)])
    np.testing.assert_array_equal(store.poses_of(ids), wanted)
    (message,) = heard.messages
    assert (message.base_version, message.pose_version) == (0, 1) and message.map_epoch == 2
    assert message.keyframes == list(range(store.count)) and message.loops == [(1, 8)]
    assert (message.loss_before, message.loss_after) == (0.5, 0.25)
    assert [(message.t[k], message.q[k]) for k in ids] == [wire_pose(T) for T in wanted]
    corrector.correct(store, ids[:1], wanted[:1], None, (0.5, 0.25))
    assert heard.messages[1].base_version == 1 and heard.messages[1].loops == []


def test_a_large_correction_comes_in_parts(tmp_path, monkeypatch):
    monkeypatch.setattr(pose_corrector, "_MOST_A_MESSAGE", 2)
    store, heard = mapped_room().store, _Heard()
    corrector = PoseCorrector(heard, MapState.create(tmp_path, localise_only=False))
    ids = np.arange(1, 6)
    wanted = np.stack([displaced(store.pose(int(k)), 0.02, 1.0) for k in ids])
    corrector.correct(store, ids, wanted, None, (0.5, 0.25), [(1, 5)])
    assert [m.keyframes for m in heard.messages] == [[0, 1], [2, 3], [4, 5], [6, 7], [8, 9]]
    assert {m.pose_version for m in heard.messages} == {1}
    assert [m.loops for m in heard.messages] == [[(1, 5)], [], [], [], []]


def test_small_motions_are_published_when_they_add_up_and_at_the_end(tmp_path):
    store, heard = mapped_room().store, _Heard()
    corrector = PoseCorrector(heard, MapState.create(tmp_path, localise_only=False))
    ids, all_ids = np.arange(1, store.count), list(range(store.count))
    for _ in range(4):
        _move(corrector, store, ids, 0.0004, {3: 0.01})
    assert [m.keyframes for m in heard.messages] == [all_ids, [4], [4], all_ids[1:]]
    _move(corrector, store, ids, 0.0004)
    assert heard.messages[-1].keyframes == []
    corrector.publish_all(store)
    last = heard.messages[-1]
    assert last.keyframes == all_ids and last.base_version == last.pose_version == 5
    poses = [pose_matrix([*t, *q]) for t, q in zip(last.t, last.q, strict=True)]
    np.testing.assert_allclose(poses, store.poses(), atol=1e-12)


def test_without_corrections_nothing_is_published_at_the_end(tmp_path):
    heard = _Heard()
    corrector = PoseCorrector(heard, MapState.create(tmp_path, localise_only=False))
    corrector.publish_all(mapped_room().store)
    assert heard.messages == []


def test_the_first_correction_of_another_map_has_all_poses(tmp_path):
    heard, state = _Heard(), MapState.create(tmp_path, localise_only=False)
    corrector = PoseCorrector(heard, state)
    for epoch in range(2):
        state.map_epoch = epoch
        store = mapped_room().store
        _move(corrector, store, np.array([2, 5]), 0.01)
        assert heard.messages[-1].keyframes == list(range(store.count))
        assert heard.messages[-1].map_epoch == epoch


def test_what_another_process_has_corrected_is_published_again(tmp_path):
    store, heard = mapped_room().store, _Heard()
    state = MapState.create(tmp_path, localise_only=False)
    ours, theirs = PoseCorrector(heard, state), PoseCorrector(heard, state)
    ids = np.array([2, 5])
    for corrector, motion_m in ((ours, 0.01), (theirs, 0.5), (ours, -0.4995)):
        _move(corrector, store, ids, motion_m)
    assert heard.messages[-1].keyframes == [2, 5]


def _move(corrector, store, ids, motion_m, more_m=None) -> None:
    """Correct keyframes `ids` by a motion along x, and those of some places by another one."""
    moved = store.poses_of(ids)
    moved[:, 0, 3] += motion_m
    for place, more in (more_m or {}).items():
        moved[place, 0, 3] += more
    corrector.correct(store, ids, moved, None, (0.5, 0.25))
