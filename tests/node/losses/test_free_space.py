import pytest
import torch

from hsslam_node.losses.free_space import free_space_loss


def test_space_in_front_wants_one_and_space_behind_nothing():
    z = torch.tensor([[0.5, 1.0, 3.0]])
    sdf = torch.tensor([[0.0, 0.5, -1.0]])
    loss = free_space_loss(sdf, z, torch.tensor([2.0]), torch.ones(1, 3, dtype=torch.bool), 0.06)
    assert float(loss) == pytest.approx((1.0 + 0.25) / 2)
