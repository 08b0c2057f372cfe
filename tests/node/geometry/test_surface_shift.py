import numpy as np
import pytest

from hsslam_node.geometry.view_distance import surface_shift_m


def _poses(n):
    return np.tile(np.eye(4), (n, 1, 1))


def test_the_keyframe_that_moved_most_counts():
    after = _poses(3)
    after[0, 0, 3], after[2, 1, 3] = 0.01, -0.04
    assert surface_shift_m(_poses(3), after) == pytest.approx(0.04)


def test_a_turn_moves_what_is_two_metres_away():
    angle = 0.02
    after = _poses(1)
    after[0, :2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    assert surface_shift_m(_poses(1), after) == pytest.approx(2 * angle, rel=1e-3)


def test_no_keyframes_no_shift():
    assert surface_shift_m(_poses(0), _poses(0)) == 0.0
