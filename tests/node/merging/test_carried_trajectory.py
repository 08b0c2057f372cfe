"""Poses of frames follow the keyframes next to them in time."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.merging.carried_trajectory import carried, joined

_SMALL = st.floats(-1.0, 1.0)


def _poses(count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.stack([se3_exp(rng.normal(size=6)) for _ in range(count)])


@given(st.lists(_SMALL, min_size=6, max_size=6), st.integers(1, 5))
def test_a_map_that_moves_as_one_takes_its_frames_along(twist, keyframes):
    T = se3_exp(np.array(twist))
    frames = Trajectory(np.arange(20, dtype=np.int64) * 10, _poses(20, 0))
    before = Trajectory(np.arange(keyframes, dtype=np.int64) * 40, _poses(keyframes, 1))
    found = carried(frames, before, T @ before.T_world_cam)
    np.testing.assert_array_equal(found.stamps_ns, frames.stamps_ns)
    np.testing.assert_allclose(found.T_world_cam, T @ frames.T_world_cam, atol=1e-9)


def test_each_frame_follows_the_keyframe_nearest_in_time():
    frames = Trajectory(np.array([0, 40, 60, 200], np.int64), np.tile(np.eye(4), (4, 1, 1)))
    before = Trajectory(np.array([100, 0], np.int64), np.tile(np.eye(4), (2, 1, 1)))
    after = before.T_world_cam.copy()
    after[:, 0, 3] = 5.0, 1.0
    assert carried(frames, before, after).positions[:, 0].tolist() == [1.0, 1.0, 5.0, 5.0]


def test_a_frame_follows_no_keyframe_of_another_session_with_the_same_stamps():
    stamps_ns = np.arange(0, 200, 20, dtype=np.int64)
    own, other = np.tile(np.eye(4), (2, len(stamps_ns), 1, 1))
    own[:, 0, 3], other[:, 1, 3] = 0.001 * stamps_ns, 3.0
    frames_ns = np.arange(0, 200, 5, dtype=np.int64)
    T = np.tile(np.eye(4), (len(frames_ns), 1, 1))
    T[:, 0, 3] = 0.001 * frames_ns
    before = Trajectory(np.concatenate([stamps_ns, stamps_ns + 1]), np.concatenate([own, other]))
    after = before.T_world_cam.copy()
    after[: len(own), 2, 3] = 0.08
    found = carried(Trajectory(frames_ns, T), before, after)
    np.testing.assert_allclose(found.positions[:, 2], 0.08)


def test_a_session_of_which_the_map_keeps_few_keyframes_follows_those_of_the_other():
    """The map keeps two keyframes of the second day, at the end of the way; the merge mends 1 % of drift."""

    def at(x: np.ndarray) -> np.ndarray:
        T = np.tile(np.eye(4), (len(x), 1, 1))
        T[:, 0, 3] = x
        return T

    day_ns = 86_400 * 10**9
    x = np.concatenate([np.linspace(0, 10, 50), [9.0, 10.0]])
    stamps_ns = np.concatenate([np.arange(50) * 10**9, day_ns + np.array([900, 999]) * 10**9])
    way = np.linspace(0, 10, 1000)
    frames = Trajectory(day_ns + np.arange(1000) * 10**9, at(way))
    found = carried(frames, Trajectory(stamps_ns, at(x)), at(1.01 * x))
    assert np.abs(found.positions[:, 0] - 1.01 * way).max() < 0.01


def test_sessions_are_joined_in_the_order_of_their_stamps():
    first = Trajectory(np.array([10, 30], np.int64), _poses(2, 0))
    second = Trajectory(np.array([20], np.int64), _poses(1, 1))
    found = joined(first, second)
    assert found.stamps_ns.tolist() == [10, 20, 30]
    np.testing.assert_array_equal(found.T_world_cam[1], second.T_world_cam[0])


def test_poses_of_one_stamp_are_kept_in_the_order_of_the_sessions():
    first = Trajectory(np.array([10, 30], np.int64), _poses(2, 0))
    second = Trajectory(np.array([10, 20], np.int64), _poses(2, 1))
    found = joined(first, second)
    assert found.stamps_ns.tolist() == [10, 10, 20, 30]
    for k, expected in enumerate((first, second)):
        np.testing.assert_array_equal(found.T_world_cam[k], expected.T_world_cam[0])
