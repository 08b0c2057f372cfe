"""Keyframes that were corrected come back first, and for a while only."""

import numpy as np

from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.mapping.mapper import MovedKeyframes


def _poses(n: int) -> np.ndarray:
    T = [se3_exp(np.array([0.1 * k, 0, 0, 0, 0.02 * k, 0])) for k in range(n)]
    return np.array(T).reshape(n, 4, 4)


def _draws(
    moved: MovedKeyframes, poses: np.ndarray, ids: np.ndarray | None = None, wanted: int = 3
) -> list[int]:
    """Twenty draws of `wanted` each."""
    generator = np.random.default_rng(0)
    ids = np.arange(len(poses)) if ids is None else ids
    return [int(k) for _ in range(20) for k in moved.draw(ids, poses[ids], wanted, generator)]


def test_nothing_has_moved_at_first_nor_when_keyframes_come():
    moved = MovedKeyframes()
    assert _draws(moved, _poses(0)) == [] and _draws(moved, _poses(5)) == []
    assert _draws(moved, _poses(9)) == []


def test_what_has_moved_is_drawn_equally_often_and_then_rests():
    moved, poses = MovedKeyframes(), _poses(9)
    _draws(moved, poses)
    poses[[2, 5, 6, 7], 0, 3] += 0.01
    drawn = _draws(moved, poses)
    assert set(drawn) == {2, 5, 6, 7}
    assert len({drawn.count(k) for k in (2, 5, 6, 7)}) == 1
    assert _draws(moved, poses) == []


def test_a_turn_is_a_move_and_a_tremor_is_none():
    moved, poses = MovedKeyframes(), _poses(9)
    _draws(moved, poses)
    poses[3] = poses[3] @ se3_exp(np.array([0, 0, 0, 0, 0.002, 0]))
    poses[4] = poses[4] @ se3_exp(np.array([2e-4, 0, 0, 0, 2e-4, 0]))
    assert set(_draws(moved, poses)) == {3}


def test_a_keyframe_that_moves_again_is_due_again():
    moved, poses = MovedKeyframes(), _poses(4)
    _draws(moved, poses)
    poses[1, 2, 3] += 0.02
    before = len(_draws(moved, poses))
    poses[1, 2, 3] += 0.02
    assert len(_draws(moved, poses)) == before > 0


def test_those_that_are_retired_are_not_drawn():
    moved, poses = MovedKeyframes(), _poses(9)
    _draws(moved, poses)
    poses[[2, 5, 7], 0, 3] += 0.01
    assert set(_draws(moved, poses, np.array([0, 2, 3, 7, 8]))) == {2, 7}
