import numpy as np
import pytest
import torch

from hsslam_node.map.initialisation import initial_parameters
from hsslam_node.reference.field import HybridField, decode_color, decode_geometry


@pytest.fixture
def field(layout):
    params = initial_parameters(layout, 0).astype(np.float64)
    noise = np.random.default_rng(0).normal(0, 0.1, params.shape)
    return HybridField(layout, torch.from_numpy(params + noise))


def _points(layout, count, seed=0):
    unit = np.random.default_rng(seed).random((count, 3))
    return torch.from_numpy(np.asarray(layout.bound.low) + unit * layout.bound.extent_m)


def test_shapes_and_ranges(field, layout):
    with torch.no_grad():
        out = field(_points(layout, 64))
    assert out.sdf.shape == (64,) and out.color.shape == (64, 3)
    assert out.hash_feature.shape == (64, 32) and bool(out.inside.all())
    assert float(out.sdf.abs().max()) <= 1.0
    torch.testing.assert_close(field.sdf(_points(layout, 64)).detach(), out.sdf)


def test_outside_is_marked(field, layout):
    points = _points(layout, 4)
    points[1, 2] = layout.bound.high[2] + 1e-6
    points[3, 0] = layout.bound.low[0] - 5.0
    assert field(points).inside.tolist() == [True, False, True, False]


def test_color_does_not_see_the_hash_except_through_g(field, layout):
    points = _points(layout, 16)
    with torch.no_grad():
        field.block("geometry_decoder.W2")[:] = 0.0
        before = field(points).color.clone()
        field.block("hash.00")[:] += 1.0
        torch.testing.assert_close(field(points).color, before)


def test_gradient_to_points_matches_finite_differences(field, layout):
    points = _points(layout, 3).requires_grad_()

    def outputs(points):
        out = field(points)
        return out.sdf, out.color

    assert torch.autograd.gradcheck(outputs, (points,), eps=1e-7, atol=1e-4)


def test_gradient_to_parameters_matches_a_directional_difference(field, layout):
    points = _points(layout, 40)
    direction = torch.from_numpy(np.random.default_rng(5).normal(size=layout.parameter_count))

    def scalar():
        out = field(points)
        return out.sdf.sum() + out.color.square().sum()

    scalar().backward()
    slope = float(field.params.grad @ direction)
    with torch.no_grad():
        step = 1e-7
        field.params += step * direction
        above = float(scalar())
        field.params -= 2 * step * direction
        below = float(scalar())
    assert slope == pytest.approx((above - below) / (2 * step), rel=1e-4)


def test_beta_is_positive_and_starts_at_the_configured_value(layout):
    field = HybridField(layout)
    assert float(field.beta.detach()) == pytest.approx(10.0, rel=1e-5)


def test_parameters_of_another_layout_are_refused(layout):
    with pytest.raises(ValueError, match="expected"):
        HybridField(layout, torch.zeros(10))


def test_geometry_is_a_bounded_distance_and_a_feature():
    W1, W2 = torch.randn(20, 32), torch.randn(32, 16)
    x = torch.randn(9, 20) * 10
    sdf, g = decode_geometry(x, W1, W2)
    out = torch.clamp(x @ W1, min=0) @ W2
    assert sdf.shape == (9,) and g.shape == (9, 15)
    torch.testing.assert_close(sdf, torch.tanh(out[:, 0]))
    torch.testing.assert_close(g, out[:, 1:])
    assert float(sdf.abs().max()) <= 1.0


def test_color_is_between_zero_and_one():
    color = decode_color(torch.randn(50, 20) * 10, torch.randn(20, 32), torch.randn(32, 3))
    assert color.shape == (50, 3)
    assert float(color.min()) >= 0.0 and float(color.max()) <= 1.0


def test_zero_features_give_the_middle():
    sdf, _ = decode_geometry(torch.zeros(1, 20), torch.randn(20, 32), torch.randn(32, 16))
    color = decode_color(torch.zeros(1, 20), torch.randn(20, 32), torch.randn(32, 3))
    assert float(sdf) == 0.0
    torch.testing.assert_close(color, torch.full((1, 3), 0.5))
