from dataclasses import dataclass

import torch

from hsslam_node.losses.total import LossTerms, total_loss


@dataclass(frozen=True)
class _Weights:
    color: float = 5.0
    depth: float = 0.1
    sdf_middle: float = 200.0
    sdf_tail: float = 10.0
    free_space: float = 5.0
    patch: float = 0.5
    smoothness: float = 1e-6


def test_total_is_the_weighted_sum():
    terms = LossTerms(*torch.eye(7).unbind(0))
    total = total_loss(terms, _Weights())
    torch.testing.assert_close(total, torch.tensor([5.0, 0.1, 200.0, 10.0, 5.0, 0.5, 1e-6]))
    assert total_loss(LossTerms(depth=2.0), _Weights()) == 0.2
