import numpy as np
import pytest
import torch

from hsslam_node.geometry.bound import Bound
from hsslam_node.losses.smoothness import smoothness_cube, smoothness_loss


def test_constant_feature_costs_nothing_and_a_ramp_its_slope():
    n = 8
    assert float(smoothness_loss(torch.full((n, n, n, 4), 3.0))) == 0.0
    ramp = torch.arange(n, dtype=torch.float64)[:, None, None, None].expand(n, n, n, 1) * 0.5
    assert float(smoothness_loss(ramp)) == pytest.approx(0.25 * (n - 1) / n)


def test_cube_is_regular_and_inside():
    bound = Bound((-1.0, 0.0, 2.0), (3.0, 2.0, 2.5))
    cube = smoothness_cube(bound, 8, 0.1, np.random.default_rng(0))
    assert cube.shape == (8, 8, 8, 3)
    assert bound.contains(cube.reshape(-1, 3)).all()
    np.testing.assert_allclose(np.diff(cube[:, 0, 0, 0]), 0.1, rtol=1e-4)
    np.testing.assert_allclose(np.diff(cube[0, :, 0, 1]), 0.1, rtol=1e-4)
