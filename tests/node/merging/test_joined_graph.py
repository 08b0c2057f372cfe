"""The pose graph of two maps."""

from dataclasses import replace

import numpy as np

from hsslam_node.geometry.se3 import inverse
from hsslam_node.map.store import KeyframeStore
from hsslam_node.merging.joined_graph import JoinedGraph
from tests.small_room import SMALL, displaced, pose_error
from tests.two_sessions import FIRST, SECOND, meetings, session, walk


def _joined(off_m: float, off_deg: float) -> tuple[KeyframeStore, np.ndarray]:
    """Both sessions in one store, the second displaced; and the true poses."""
    first, (frames, poses) = session(FIRST)[0], walk()
    truth = inverse(poses[0]) @ np.concatenate([poses[FIRST], poses[SECOND]])
    off = displaced(np.eye(4), off_m, off_deg)
    for frame, T in zip(frames[SECOND], truth[8:], strict=True):
        first.append(frame, off @ T)
    return first, truth


def test_the_graph_puts_the_second_map_where_it_belongs():
    store, truth = _joined(0.05, 1.0)
    solved, confirmed = JoinedGraph(store, 8, SMALL, seed=0).solve(meetings())
    assert len(confirmed) > 0.7 * len(meetings())
    np.testing.assert_array_equal(solved[0], truth[0])
    for T, true in zip(solved, truth, strict=True):
        off_m, off_deg = pose_error(T, true)
        assert off_m < 0.01 and off_deg < 0.3


def test_a_wrong_meeting_is_not_confirmed_and_moves_nothing():
    store, truth = _joined(0.0, 0.0)
    *good, m = meetings()[:7]
    wrong = replace(m, first=7, second=0, T_world_first=truth[7])
    solved, confirmed = JoinedGraph(store, 8, SMALL, seed=0).solve([*good, wrong])
    assert wrong not in confirmed and confirmed
    assert max(pose_error(T, true)[0] for T, true in zip(solved, truth, strict=True)) < 0.01
