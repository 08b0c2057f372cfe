import numpy as np
import torch

from hsslam_node.geometry.pose_adam import PoseAdam


def test_steps_are_those_of_torch():
    rng = np.random.default_rng(0)
    twist = torch.zeros(6, dtype=torch.float64, requires_grad=True)
    reference = torch.optim.Adam([twist], lr=0.02, betas=(0.5, 0.999))
    adam, moved = PoseAdam(0.5), np.zeros(6)
    for _ in range(12):
        gradient = rng.normal(size=6) * np.logspace(-3, 3, 6)
        twist.grad = torch.from_numpy(gradient)
        reference.step()
        moved += adam.step(gradient, 0.02)
    np.testing.assert_allclose(moved, twist.detach().numpy(), rtol=1e-6)
    assert (np.abs(moved) > 0.01).all()


def test_translation_and_rotation_have_rates_of_their_own():
    step = PoseAdam(0.9).step(np.ones(6), np.array([0.1] * 3 + [0.2] * 3))
    np.testing.assert_allclose(step, [-0.1] * 3 + [-0.2] * 3, rtol=1e-6)


def test_without_a_gradient_nothing_moves():
    assert not PoseAdam(0.9).step(np.zeros(6), 0.1).any()
