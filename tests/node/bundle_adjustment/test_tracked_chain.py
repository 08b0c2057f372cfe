"""The chain of tracked motion when keyframes are retired."""

import numpy as np

from hsslam_node.bundle_adjustment.graph_adjustment import GraphBundleAdjustment
from hsslam_node.bundle_adjustment.tracked_chain import TrackedChain
from hsslam_node.config import PoseGraphConfig
from hsslam_node.geometry.se3 import inverse, se3_exp
from tests.node.bundle_adjustment.test_graph_adjustment import _config, _errors, _move
from tests.small_room import mapped_room

CONFIG = PoseGraphConfig(anchor_gap=3)


def _chain(n: int) -> tuple[TrackedChain, np.ndarray]:
    poses = np.array([se3_exp(np.array([0.1 * k, 0, 0.02 * k, 0, 0.05 * k, 0])) for k in range(n)])
    chain = TrackedChain(CONFIG)
    for k in range(1, n):
        chain.add(k, inverse(poses[k - 1]) @ poses[k])
    return chain, poses


def test_what_lay_between_two_that_stay_becomes_one_edge_that_is_less_sure():
    chain, poses = _chain(8)
    assert not chain.retain(set(range(8)), poses)
    assert chain.retain({0, 1, 4, 7}, poses) and chain.keyframes.tolist() == [0, 1, 4, 7]
    edges = chain.edges_to(np.array([1, 4, 7]))
    assert [(e.first, e.second) for e in edges] == [(0, 1), (1, 4), (4, 7)]
    for edge in edges:
        expected = inverse(poses[edge.first]) @ poses[edge.second]
        np.testing.assert_allclose(edge.T_first_second, expected, atol=1e-12)
    np.testing.assert_allclose(edges[1].information, edges[0].information / 3)
    chain.retain({0, 7}, poses)  # and again
    np.testing.assert_allclose(
        chain.edges_to(np.array([7]))[0].information, edges[0].information / 7
    )


def test_motion_over_a_retired_keyframe_is_not_summed_up():
    chain, poses = _chain(6)
    assert [(e.first, e.second) for e in chain.add(6, np.eye(4))] == [(3, 6)]
    chain.retain({0, 1, 2, 3, 4, 6}, np.concatenate([poses, poses[-1:]]))
    assert chain.add(7, np.eye(4)) == []


def test_a_displaced_keyframe_comes_back_among_retired_ones():
    room = mapped_room(_config())
    truth = room.store.poses()
    ba = GraphBundleAdjustment(room.config, room.parameters, 0)
    ba.round(room.store)
    room.store.retire(3, 2)
    room.store.retire(4, 2)
    ba._seen = 1  # as after a restart: all edges are measured again
    _move(room, 6, 0.02, 1.0)
    report = ba.round(room.store)
    assert not {3, 4} & set(report.keyframes.tolist())
    room.store.correct_poses(report.keyframes, report.T_world_cam, report.known)
    errors = _errors(room.store.poses(), truth)
    assert errors[6, 0] < 0.003 and errors[:, 0].max() < 0.004


def test_an_edge_of_a_keyframe_that_is_gone_is_gone():
    room = mapped_room(_config())
    ba = GraphBundleAdjustment(room.config, room.parameters, 0)
    ba.round(room.store)
    assert any(5 in (e.first, e.second) for e in ba._edges)
    room.store.retire(5, 6)
    ba.round(room.store)
    assert not any(5 in (e.first, e.second) for e in ba._edges)
    assert 5 not in ba._chain.keyframes
