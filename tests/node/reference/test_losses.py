import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.reference.losses import (
    color_loss,
    depth_loss,
    free_space_loss,
    sdf_losses,
    smoothness_loss,
)


def test_mean_over_rays_and_channels():
    color, measured = torch.zeros(4, 3), torch.full((4, 3), 0.5)
    measured[0] = 0.0
    assert float(color_loss(color, measured)) == 0.25 * 3 / 4
    valid = torch.tensor([True, False, False, False])
    assert float(color_loss(color, measured, valid)) == 0.0


def test_no_ray_is_zero_with_zero_gradient():
    color = torch.rand(4, 3, requires_grad=True)
    loss = color_loss(color, torch.rand(4, 3), torch.zeros(4, dtype=torch.bool))
    loss.backward()
    assert float(loss.detach()) == 0.0 and not color.grad.any()
    assert float(color_loss(torch.zeros(0, 3), torch.zeros(0, 3))) == 0.0


def test_only_measured_rays_count():
    loss = depth_loss(torch.tensor([1.0, 9.0, 2.0]), torch.tensor([1.5, 0.0, 2.0]))
    assert float(loss) == 0.125


def test_no_measurement_is_zero():
    depth = torch.rand(5, requires_grad=True)
    loss = depth_loss(depth, torch.zeros(5))
    loss.backward()
    assert float(loss.detach()) == 0.0 and not depth.grad.any()


def test_space_in_front_wants_one_and_space_behind_nothing():
    z = torch.tensor([[0.5, 1.0, 3.0]])
    sdf = torch.tensor([[0.0, 0.5, -1.0]])
    loss = free_space_loss(sdf, z, torch.tensor([2.0]), torch.ones(1, 3, dtype=torch.bool), 0.06)
    assert float(loss) == pytest.approx((1.0 + 0.25) / 2)


def test_space_in_front_costs_nothing_above_the_least_distance():
    z = torch.tensor([[0.5, 1.0, 1.5, 3.0]])
    sdf = torch.tensor([[0.0, 0.2, 0.7, -1.0]])
    inside = torch.ones(1, 4, dtype=torch.bool)
    loss = free_space_loss(sdf, z, torch.tensor([2.0]), inside, 0.06, free_sdf=0.3)
    assert float(loss) == pytest.approx((0.09 + 0.01 + 0.0) / 3)


T = 0.06


def _batch(offsets, depth=2.0):
    z = torch.tensor([[depth + o for o in offsets]], dtype=torch.float64)
    return z, torch.tensor([depth], dtype=torch.float64), torch.ones_like(z, dtype=torch.bool)


def test_bands_are_middle_tail_free_and_nothing_behind():
    offsets = [-0.5, -0.061, -0.05, -0.023, 0.0, 0.023, 0.03, 0.059, 0.061, 0.5]
    z, depth, inside = _batch(offsets)
    for k, offset in enumerate(offsets):
        sdf = ((depth[:, None] - z) / T).clamp(-1, 1)
        sdf[0, k] += 0.5
        middle, tail = sdf_losses(sdf, z, depth, inside, T)
        free = free_space_loss(sdf, z, depth, inside, T)
        wrong = [name for name, v in (("m", middle), ("t", tail), ("f", free)) if v > 1e-9]
        if offset < -T:
            assert wrong == ["f"]
        elif abs(offset) < 0.4 * T:
            assert wrong == ["m"]
        elif abs(offset) < T:
            assert wrong == ["t"]
        else:
            assert wrong == []


@given(st.floats(-0.05, 0.05), st.floats(0.3, 5.0))
def test_the_true_distance_costs_nothing(offset, depth):
    z, measured, inside = _batch([offset], depth)
    sdf = (measured[:, None] - z) / T
    middle, tail = sdf_losses(sdf, z, measured, inside, T)
    assert float(middle) < 1e-12 and float(tail) < 1e-12


def test_rays_weigh_the_same_whatever_their_samples():
    z = torch.tensor([[2.0, 2.0, 2.0], [2.0, 9.0, 9.0]])
    sdf = torch.tensor([[0.1, 0.1, 0.1], [0.3, 0.0, 0.0]])
    measured = torch.full((2,), 2.0)
    middle, _ = sdf_losses(sdf, z, measured, torch.ones(2, 3, dtype=torch.bool), T)
    assert float(middle) == pytest.approx(((0.1 * T) ** 2 + (0.3 * T) ** 2) / 2, rel=1e-4)


@pytest.mark.parametrize("reason", ["no depth", "outside"])
def test_nothing_to_supervise_is_zero_with_zero_gradient(reason):
    z, measured, inside = _batch([-0.5, -0.05, 0.0])
    sdf = torch.rand_like(z).requires_grad_()
    if reason == "no depth":
        measured = measured * 0
    else:
        inside = ~inside
    middle, tail = sdf_losses(sdf, z, measured, inside, T)
    total = middle + tail + free_space_loss(sdf, z, measured, inside, T)
    total.backward()
    assert float(total.detach()) == 0.0 and not sdf.grad.any()


def test_constant_feature_costs_nothing_and_a_ramp_its_slope():
    n = 8
    assert float(smoothness_loss(torch.full((n, n, n, 4), 3.0))) == 0.0
    ramp = torch.arange(n, dtype=torch.float64)[:, None, None, None].expand(n, n, n, 1) * 0.5
    assert float(smoothness_loss(ramp)) == pytest.approx(0.25 * (n - 1) / n)
