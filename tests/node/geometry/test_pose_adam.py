import numpy as np
import torch
from torch.optim.adam import adam as adam_of_torch  # the class would import torch.compile

from hsslam_node.geometry.pose_adam import PoseAdam


def test_steps_are_those_of_torch():
    rng = np.random.default_rng(0)
    twist, first, second = torch.zeros((3, 6), dtype=torch.float64)
    count = torch.tensor(0.0)
    adam, moved = PoseAdam(0.5), np.zeros(6)
    for _ in range(12):
        gradient = rng.normal(size=6) * np.logspace(-3, 3, 6)
        adam_of_torch(
            [twist], [torch.from_numpy(gradient)], [first], [second], [], [count], amsgrad=False,
            beta1=0.5, beta2=0.999, lr=0.02, weight_decay=0.0, eps=1e-8, maximize=False,
        )  # fmt: skip
        moved += adam.step(gradient, 0.02)
    np.testing.assert_allclose(moved, twist.numpy(), rtol=1e-6)
    assert (np.abs(moved) > 0.01).all()


def test_translation_and_rotation_have_rates_of_their_own():
    step = PoseAdam(0.9).step(np.ones(6), np.array([0.1] * 3 + [0.2] * 3))
    np.testing.assert_allclose(step, [-0.1] * 3 + [-0.2] * 3, rtol=1e-6)


def test_without_a_gradient_nothing_moves():
    assert not PoseAdam(0.9).step(np.zeros(6), 0.1).any()
