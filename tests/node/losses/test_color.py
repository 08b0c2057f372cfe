import torch

from hsslam_node.losses.color import color_loss


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
