"""Views of a whole scene from above."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.geometry.view_from_above import looking_down, mean_ahead, mean_up

UP = st.tuples(*[st.floats(-1, 1)] * 3).map(np.array).filter(lambda v: np.linalg.norm(v) > 0.1)


@given(UP, UP, st.floats(0.1, 1.5))
def test_it_looks_ahead_and_down_by_the_elevation_and_keeps_up_up(up, ahead, elevation):
    up = up / np.linalg.norm(up)
    R = looking_down(up, ahead, elevation)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1)
    assert R[:, 2] @ up == pytest.approx(-np.sin(elevation))
    assert R[:, 0] @ up == pytest.approx(0, abs=1e-12)  # the horizon is level
    assert R[:, 1] @ up == pytest.approx(-np.cos(elevation))
    assert R[:, 2] @ (ahead - (ahead @ up) * up) > 0 or np.linalg.norm(np.cross(ahead, up)) < 1e-3


def test_without_a_direction_ahead_it_still_looks_down():
    up = np.array([0, -1.0, 0])
    for ahead in (np.zeros(3), up):
        R = looking_down(up, ahead, 0.5)
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
        assert R[:, 2] @ up == pytest.approx(-np.sin(0.5))


def test_up_and_ahead_are_those_of_the_images():
    poses = np.array([se3_exp(np.array([0, 0, 0, tilt, 0, 0])) for tilt in (-0.3, 0.3)])
    np.testing.assert_allclose(mean_up(poses), [0, -1, 0], atol=1e-12)
    np.testing.assert_allclose(mean_ahead(poses), [0, 0, np.cos(0.3)], atol=1e-12)


def _turned(axis: int, angles: tuple[float, ...]) -> np.ndarray:
    return np.array([se3_exp(angle * np.eye(6)[3 + axis]) for angle in angles])


def test_up_of_a_camera_that_looks_straight_down_and_turns_is_against_its_view():
    around = _turned(2, (0, 0.5 * np.pi, np.pi, -0.5 * np.pi))
    np.testing.assert_allclose(mean_up(around), [0, 0, -1], atol=1e-12)


def test_up_is_a_direction_though_all_directions_cancel_out():
    assert np.linalg.norm(mean_up(_turned(0, (0, np.pi)))) == pytest.approx(1)
