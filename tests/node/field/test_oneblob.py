import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.field.oneblob import oneblob, oneblob_of_points


@given(st.floats(1 / 16, 15 / 16))
def test_bins_are_a_partition_of_unity_away_from_the_borders(t):
    bins = oneblob(torch.tensor([t], dtype=torch.float64))
    assert bins.shape == (1, 16)
    assert float(bins.sum()) == pytest.approx(1.0, abs=1e-12)
    assert float(bins.min()) >= 0.0


@given(st.floats(-1.0, 2.0))
def test_mass_outside_is_dropped(t):
    total = float(oneblob(torch.tensor([t], dtype=torch.float64)).sum())
    assert -1e-12 <= total <= 1.0 + 1e-12
    assert float(oneblob(torch.tensor([0.0])).sum()) == pytest.approx(0.5, abs=1e-6)


def test_bins_are_the_integral_of_the_quartic_kernel():
    t = 0.41
    x = np.linspace(0.0, 1.0, 160_001)
    u = (x - t) * 16
    kernel = np.where(np.abs(u) < 1, 15 / 16 * (1 - u**2) ** 2, 0.0) * 16
    steps = (kernel[1:] + kernel[:-1]) / 2 * (x[1] - x[0])
    expected = steps.reshape(16, -1).sum(axis=1)
    actual = oneblob(torch.tensor([t], dtype=torch.float64))[0].numpy()
    np.testing.assert_allclose(actual, expected, atol=1e-8)


def test_gradient_matches_finite_differences():
    t = torch.linspace(-0.1, 1.1, 37, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(oneblob, (t,))


def test_points_are_encoded_axis_after_axis():
    low, high = torch.tensor([0.0, -1.0, 2.0]), torch.tensor([2.0, 1.0, 3.0])
    points = low + torch.rand(20, 3) * (high - low)
    blob = oneblob_of_points(points, low, high)
    assert blob.shape == (20, 48)
    torch.testing.assert_close(blob[:, 16:32], oneblob((points[:, 1] + 1.0) / 2.0))
