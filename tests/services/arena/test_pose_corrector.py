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
    assert message.keyframes == [3, 6] and message.loops == [(1, 8)]
    assert (message.loss_before, message.loss_after) == (0.5, 0.25)
    assert list(zip(message.t, message.q, strict=True)) == [wire_pose(T) for T in wanted]
    corrector.correct(store, ids[:1], wanted[:1], None, (0.5, 0.25))
    assert heard.messages[1].base_version == 1 and heard.messages[1].loops == []


def test_a_large_correction_comes_in_parts(tmp_path, monkeypatch):
    monkeypatch.setattr(pose_corrector, "_MOST_A_MESSAGE", 2)
    store, heard = mapped_room().store, _Heard()
    corrector = PoseCorrector(heard, MapState.create(tmp_path, localise_only=False))
    ids = np.arange(1, 6)
    wanted = np.stack([displaced(store.pose(int(k)), 0.02, 1.0) for k in ids])
    corrector.correct(store, ids, wanted, None, (0.5, 0.25), [(1, 5)])
    assert [m.keyframes for m in heard.messages] == [[1, 2], [3, 4], [5]]
    assert {m.pose_version for m in heard.messages} == {1}
    assert [m.loops for m in heard.messages] == [[(1, 5)], [], []]


def test_small_motions_are_published_when_they_add_up_and_at_the_end(tmp_path):
    store, heard = mapped_room().store, _Heard()
    corrector = PoseCorrector(heard, MapState.create(tmp_path, localise_only=False))
    ids, all_ids = np.arange(1, store.count), list(range(1, store.count))
    for _ in range(4):
        moved = store.poses_of(ids)
        moved[:, 0, 3] += 0.0004
        moved[3, 0, 3] += 0.01
        corrector.correct(store, ids, moved, None, (0.5, 0.25))
    assert [m.keyframes for m in heard.messages] == [all_ids, [4], [4], all_ids]
    moved[:, 1, 3] += 0.0004
    corrector.correct(store, ids, moved, None, (0.5, 0.25))
    assert heard.messages[-1].keyframes == []
    corrector.publish_rest(store)
    rest = heard.messages[-1]
    assert rest.keyframes == [0, *all_ids] and rest.base_version == rest.pose_version == 5
    poses = [pose_matrix([*t, *q]) for t, q in zip(rest.t, rest.q, strict=True)]
    np.testing.assert_allclose(poses, store.poses(), atol=1e-12)
    corrector.publish_rest(store)
    assert heard.messages[-1] is rest
