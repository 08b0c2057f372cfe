import numpy as np
import pytest
import torch

from hsslam_node.kernels.field.gradient import gradient
from hsslam_node.kernels.mapping.smoothness import smoothness_backward
from hsslam_node.mapping.step_inputs import smoothness_cube
from hsslam_node.reference.losses import smoothness_loss


def test_loss_and_gradient_are_the_reference(field, close):
    cube = smoothness_cube(field.layout.bound, 6, 0.1, np.random.default_rng(0))
    points = torch.from_numpy(cube.reshape(-1, 3).astype(np.float64))
    loss = smoothness_loss(field.reference.hash_feature(points).view(6, 6, 6, -1))
    (expected,) = torch.autograd.grad(2.5 * loss, field.reference.params)
    grad = gradient(field.kernel)
    value = smoothness_backward(field.params, field.kernel, cube, np.float32(2.5), grad)
    assert value == pytest.approx(float(loss.detach()), rel=1e-3)
    close(grad.values, expected.numpy(), 1e-3)
