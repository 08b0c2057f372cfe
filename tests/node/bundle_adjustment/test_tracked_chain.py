"""The chain of tracked motion: across a gap that odometry bridges, and when keyframes are retired."""

import numpy as np

from hsslam_node.bundle_adjustment.graph_adjustment import GraphBundleAdjustment
from hsslam_node.bundle_adjustment.pose_graph import PoseEdge, PoseEdges, solve_pose_graph
from hsslam_node.bundle_adjustment.tracked_chain import TrackedChain
from hsslam_node.config import PoseGraphConfig
from hsslam_node.geometry.se3 import inverse, se3_exp
from tests.node.bundle_adjustment.test_graph_adjustment import _config, _errors, _move
from tests.small_room import mapped_room, room_frames

CONFIG = PoseGraphConfig(anchor_gap=3)


def _chain(n: int) -> tuple[TrackedChain, np.ndarray]:
    poses = np.array([se3_exp(np.array([0.1 * k, 0, 0.02 * k, 0, 0.05 * k, 0])) for k in range(n)])
    chain = TrackedChain(CONFIG)
    for k in range(1, n):
        chain.add(k, inverse(poses[k - 1]) @ poses[k])
    return chain, poses


def test_the_edge_over_a_gap_is_as_unsure_as_the_odometry_that_bridged_it():
    chain, poses = _chain(6)
    gap = np.diag([0.02, 0.03, 0.02, 0.01, 0.01, 0.02]) ** 2
    T = inverse(poses[4]) @ poses[5]
    assert chain.add(6, T, gap) == chain.add(7, T) == chain.add(8, T) == []  # none across the gap
    assert [(e.first, e.second) for e in chain.add(9, T)] == [(6, 9)]
    usual, over_gap = (np.linalg.inv(e.information) for e in chain.edges_to(np.array([5, 6])))
    np.testing.assert_allclose(over_gap, usual + gap, atol=1e-12)
    far = PoseEdge(5, 6, T @ se3_exp(np.full(6, 0.1)), np.eye(6), True)
    chain.doubt(6, {1: far})  # contradicted by an alignment it is less sure still
    doubted = np.linalg.inv(chain.edges_to(np.array([6]))[0].information)
    assert (np.linalg.eigvalsh(doubted - over_gap) > 0).all()


def test_an_error_of_the_gap_stays_in_the_gap_when_a_loop_closes():
    """Keyframes after the gap are 2 cm off; an alignment across all of them says so."""
    _, truth = _chain(10)
    tracked = truth.copy()
    tracked[5:, 0, 3] += 0.02
    chain = TrackedChain(CONFIG)
    for k in range(1, 10):
        gap = np.eye(6) * (0.02**2 if k == 5 else 0.0)
        chain.add(k, inverse(tracked[k - 1]) @ tracked[k], gap)
    loop = PoseEdge(0, 9, inverse(truth[0]) @ truth[9], np.eye(6) * 5e-4**-2, True)
    edges = PoseEdges.of([loop, *chain.edges_to(np.arange(1, 10))])
    solved = solve_pose_graph(tracked, edges, np.arange(10) == 0).T_world_cam
    assert np.linalg.norm((solved - truth)[:, :3, 3], axis=1).max() < 0.001


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
    ba = GraphBundleAdjustment(room.config, room.parameters, 0)  # as after a restart
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


def test_after_a_restart_the_graph_never_holds_the_retired_keyframes_of_a_long_run():
    room = mapped_room(_config(neighbours=(1,), most_keyframes=1, loops=0))
    store, frame, gap = room.store, room_frames()[36], room.config.pose_graph.anchor_gap
    for k in range(store.count, 1600):
        store.append(frame, store.pose(9))
        if k > 70 and (k - 60) % 100 not in (0, gap):
            store.retire(k - 60, 9)
    sizes = []
    ba = GraphBundleAdjustment(room.config, room.parameters, 0)
    ba.round(store, rest=lambda: sizes.append((len(ba._chain.keyframes), len(ba._edges))))
    kept = store.kept()
    assert len(sizes) > 3 and max(sum(size) for size in sizes) < 3 * len(kept)
    assert ba._chain.keyframes.tolist() == kept.tolist()
    for edge, before, k in zip(ba._chain.edges_to(kept[1:]), kept, kept[1:], strict=False):
        assert (edge.first, edge.second) == (before, k)
        usual = ba._chain.edges_to(np.array([1]))[0].information
        np.testing.assert_allclose(edge.information, usual / (k - before))
    over = {(e.first, e.second) for e in ba._edges if e.second - e.first == gap}
    assert over == {(k - gap, k) for k in kept.tolist() if k - gap in set(kept.tolist())}
