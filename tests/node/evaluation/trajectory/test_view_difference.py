import numpy as np
import pytest

from hsslam_node.evaluation.trajectory.view_difference import is_far, is_wrong, view_difference
from hsslam_node.geometry.se3 import se3_exp


def _moved(x_m: float = 0.0, turn_deg: float = 0.0) -> np.ndarray:
    T = se3_exp(np.array([0.0, 0.0, 0.0, 0.0, np.deg2rad(turn_deg), 0.0]))
    T[:3, 3] = x_m, 0.0, 0.0
    return T


def test_the_difference_is_of_place_and_of_direction_and_the_same_both_ways() -> None:
    a = np.stack([_moved(1.0, 20.0), _moved(2.0, -5.0)])
    b = np.stack([_moved(1.3, 20.0), _moved(2.0, 10.0)])
    for pair in ((a, b), (b, a)):
        distance_m, angle_deg = view_difference(*pair)
        assert distance_m == pytest.approx([0.3, 0.0], abs=1e-12)
        assert angle_deg == pytest.approx([0.0, 15.0], abs=1e-9)


@pytest.mark.parametrize(
    ("distance_m", "angle_deg", "wrong"), [(0.09, 4.9, False), (0.11, 0.0, True), (0.0, 5.1, True)]
)
def test_a_pose_is_wrong_by_either(distance_m: float, angle_deg: float, wrong: bool) -> None:
    assert is_wrong(np.array([distance_m]), np.array([angle_deg])).tolist() == [wrong]


@pytest.mark.parametrize(
    ("x_m", "turn_deg", "far"), [(0.74, 39.0, False), (0.76, 0.0, True), (0.0, 41.0, True)]
)
def test_a_view_is_far_by_either(x_m: float, turn_deg: float, far: bool) -> None:
    assert is_far(_moved(), _moved(x_m, turn_deg)) is far
