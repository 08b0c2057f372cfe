import torch

from hsslam_node.losses.depth import depth_loss


def test_only_measured_rays_count():
    loss = depth_loss(torch.tensor([1.0, 9.0, 2.0]), torch.tensor([1.5, 0.0, 2.0]))
    assert float(loss) == 0.125


def test_no_measurement_is_zero():
    depth = torch.rand(5, requires_grad=True)
    loss = depth_loss(depth, torch.zeros(5))
    loss.backward()
    assert float(loss.detach()) == 0.0 and not depth.grad.any()
