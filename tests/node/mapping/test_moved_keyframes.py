"""Keyframes that were corrected come back first, and for a while only."""

import numpy as np

from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.keyframes.rows import KeyframeRows
from hsslam_node.mapping.moved_keyframes import draw_moved


def _poses(n: int) -> np.ndarray:
    T = [se3_exp(np.array([0.1 * k, 0, 0, 0, 0.02 * k, 0])) for k in range(n)]
    return np.array(T).reshape(n, 4, 4)


def _mapped() -> KeyframeRows:
    """Rows of keyframes that the mapper has not seen yet."""
    rows = KeyframeRows(MemoryAllocator())
    assert rows.reserve(0, has_gap=False)
    return rows


def _draws(
    rows: KeyframeRows, poses: np.ndarray, ids: np.ndarray | None = None, wanted: int = 3
) -> list[int]:
    """Twenty draws of `wanted` each."""
    generator = np.random.default_rng(0)
    ids = np.arange(len(poses)) if ids is None else ids
    return [int(k) for _ in range(20) for k in draw_moved(rows, ids, poses[ids], wanted, generator)]


def test_nothing_has_moved_at_first_nor_when_keyframes_come():
    rows = _mapped()
    assert _draws(rows, _poses(0)) == [] and _draws(rows, _poses(5)) == []
    assert _draws(rows, _poses(9)) == []


def test_what_has_moved_is_drawn_equally_often_and_then_rests():
    rows, poses = _mapped(), _poses(9)
    _draws(rows, poses)
    poses[[2, 5, 6, 7], 0, 3] += 0.01
    drawn = _draws(rows, poses)
    assert set(drawn) == {2, 5, 6, 7}
    assert len({drawn.count(k) for k in (2, 5, 6, 7)}) == 1
    assert _draws(rows, poses) == []


def test_a_turn_is_a_move_and_a_tremor_is_none():
    rows, poses = _mapped(), _poses(9)
    _draws(rows, poses)
    poses[3] = poses[3] @ se3_exp(np.array([0, 0, 0, 0, 0.002, 0]))
    poses[4] = poses[4] @ se3_exp(np.array([2e-4, 0, 0, 0, 2e-4, 0]))
    assert set(_draws(rows, poses)) == {3}


def test_a_keyframe_that_moves_again_is_due_again():
    rows, poses = _mapped(), _poses(4)
    _draws(rows, poses)
    poses[1, 2, 3] += 0.02
    before = len(_draws(rows, poses))
    poses[1, 2, 3] += 0.02
    assert len(_draws(rows, poses)) == before > 0


def test_those_that_are_retired_are_not_drawn():
    rows, poses = _mapped(), _poses(9)
    _draws(rows, poses)
    poses[[2, 5, 7], 0, 3] += 0.01
    assert set(_draws(rows, poses, np.array([0, 2, 3, 7, 8]))) == {2, 7}
