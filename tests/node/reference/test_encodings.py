import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.reference.encodings import oneblob, oneblob_of_points, tri_plane_features


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


LOW = torch.tensor([-1.0, 0.0, 2.0], dtype=torch.float64)
CELL_M = 0.25


def _ramp(n_u, n_v, a, b, c):
    """A plane [n_v, n_u, 1] holding a u + b v + c."""
    v, u = torch.meshgrid(torch.arange(n_v), torch.arange(n_u), indexing="ij")
    return (a * u + b * v + c)[..., None].double()


def test_planes_are_summed_and_read_along_their_own_axes():
    planes = [_ramp(5, 6, 1, 10, 0), _ramp(5, 7, 100, 1000, 0), _ramp(6, 7, 1e4, 1e5, 0.5)]
    x, y, z = torch.rand(30), torch.rand(30) * 1.25, torch.rand(30) * 1.5
    points = LOW + torch.stack([x, y, z], -1).double()
    u = (points - LOW) / CELL_M
    expected = u[:, 0] * 101 + u[:, 1] * (10 + 1e4) + u[:, 2] * (1000 + 1e5) + 0.5
    actual = tri_plane_features(planes, points, LOW, CELL_M)[:, 0]
    torch.testing.assert_close(actual, expected)


def test_outside_takes_the_border_value():
    planes = [torch.rand(4, 4, 8, dtype=torch.float64) for _ in range(3)]
    outside = LOW + torch.tensor([[-3.0, 9.0, 0.3]], dtype=torch.float64)
    border = LOW + torch.tensor([[0.0, 0.75, 0.3]], dtype=torch.float64)
    torch.testing.assert_close(
        tri_plane_features(planes, outside, LOW, CELL_M),
        tri_plane_features(planes, border, LOW, CELL_M),
    )


def test_gradients_match_finite_differences():
    planes = [torch.rand(4, 4, 2, dtype=torch.float64, requires_grad=True) for _ in range(3)]
    points = (LOW + torch.rand(4, 3, dtype=torch.float64) * 0.7).requires_grad_()

    def features(points, *planes):
        return tri_plane_features(planes, points, LOW, CELL_M)

    assert torch.autograd.gradcheck(features, (points, *planes))
