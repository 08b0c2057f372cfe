"""Views of a whole scene from above."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.geometry.view_from_above import looking_down, mean_up

UP = st.tuples(*[st.floats(-1, 1)] * 3).map(np.array).filter(lambda v: np.linalg.norm(v) > 0.1)


@given(UP, st.floats(0.1, 1.5))
def test_it_looks_down_by_the_elevation_and_keeps_up_up(up, elevation):
    up = up / np.linalg.norm(up)
    R = looking_down(up, elevation)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1)
    assert R[:, 2] @ up == pytest.approx(-np.sin(elevation))
    assert R[:, 0] @ up == pytest.approx(0, abs=1e-12)  # the horizon is level
    assert R[:, 1] @ up == pytest.approx(-np.cos(elevation))


def test_up_is_that_of_the_images():
    poses = np.array([se3_exp(np.array([0, 0, 0, tilt, 0, 0])) for tilt in (-0.3, 0.3)])
    np.testing.assert_allclose(mean_up(poses), [0, -1, 0], atol=1e-12)
