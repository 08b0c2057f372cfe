import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from hsslam_node.reference.rendering import render_rays


def _ray(z, surface_m, truncation_m=0.06):
    return ((surface_m - z) / truncation_m).clamp(-1, 1)


@settings(max_examples=30)
@given(st.integers(0, 1000), st.floats(0.5, 60.0))
def test_weights_are_the_product_form_and_sum_to_the_opacity(seed, beta):
    generator = torch.Generator().manual_seed(seed)
    sdf = torch.rand(5, 20, generator=generator, dtype=torch.float64) * 2 - 1
    z = torch.rand(5, 20, generator=generator, dtype=torch.float64).sort(dim=1).values
    color = torch.rand(5, 20, 3, generator=generator, dtype=torch.float64)
    out = render_rays(sdf, color, z, beta)
    alpha = 1 - torch.exp(-beta * torch.sigmoid(-beta * sdf))
    transmittance = torch.cumprod(1 - alpha, dim=1)
    before = torch.cat([torch.ones(5, 1, dtype=torch.float64), transmittance[:, :-1]], dim=1)
    torch.testing.assert_close(out.weights, alpha * before)
    torch.testing.assert_close(out.opacity, 1 - transmittance[:, -1])
    assert float(out.opacity.max()) <= 1 + 1e-9
    torch.testing.assert_close(out.depth, (out.weights * z).sum(1))


def test_a_sharp_surface_is_rendered_at_its_depth():
    z = torch.linspace(0.5, 2.0, 400).repeat(2, 1)
    surface = torch.tensor([[1.2], [1.7]])
    color = torch.zeros(2, 400, 3)
    out = render_rays(_ray(z, surface), color, z, beta=200.0)
    torch.testing.assert_close(out.depth, surface[:, 0], atol=5e-3, rtol=0)
    torch.testing.assert_close(out.opacity, torch.ones(2))


def test_samples_outside_are_empty():
    sdf, color = -torch.ones(1, 8), torch.ones(1, 8, 3)
    z = torch.linspace(1, 2, 8)[None]
    inside = torch.zeros(1, 8, dtype=torch.bool)
    assert float(render_rays(sdf, color, z, 10.0, inside).opacity) == 0.0
    inside[0, 5] = True
    out = render_rays(sdf, color, z, 10.0, inside)
    assert float(out.depth) == pytest.approx(float(z[0, 5]), rel=1e-3)


def test_gradients_match_finite_differences():
    sdf = (torch.rand(2, 6, dtype=torch.float64) * 2 - 1).requires_grad_()
    color = torch.rand(2, 6, 3, dtype=torch.float64, requires_grad=True)
    beta = torch.tensor(7.0, dtype=torch.float64, requires_grad=True)
    z = torch.linspace(0.5, 1.5, 6, dtype=torch.float64).repeat(2, 1)

    def rendered(sdf, color, beta):
        out = render_rays(sdf, color, z, beta)
        return out.color, out.depth, out.opacity

    assert torch.autograd.gradcheck(rendered, (sdf, color, beta))
