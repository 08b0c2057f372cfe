import numpy as np
import pytest
import torch

from hsslam_node.gpu_kernels.field.activations import gradient
from hsslam_node.gpu_kernels.mapping.smoothness import smoothness_backward
from hsslam_node.mapping.step_inputs import smoothness_cube
from hsslam_node.reference.losses import smoothness_loss
from tests.node.gpu_kernels.conftest import empty, on_device


def test_loss_and_gradient_are_the_reference(gpu_field, close):
    field, n = gpu_field, 5
    cube = smoothness_cube(field.cpu.layout.bound, n, 0.1, np.random.default_rng(0))
    grad, loss = gradient(field.layout), empty(1)
    feature = empty(n**3, 2, field.layout.levels)
    smoothness_backward(field.params, field.layout, on_device(cube), 2.5, grad, feature, loss)
    if field.layout.levels == 0:
        assert loss == 0 and not grad.values.any()
        return
    points = torch.from_numpy(cube.reshape(-1, 3).astype(np.float64))
    reference = smoothness_loss(field.cpu.reference.hash_feature(points).view(n, n, n, -1))
    (expected,) = torch.autograd.grad(2.5 * reference, field.cpu.reference.params)
    assert float(loss[0]) == pytest.approx(float(reference.detach()), rel=1e-4)
    close(grad.values.cpu().numpy(), expected.numpy())
    written = grad.values.view(-1, 16).any(dim=1)
    assert written.any() and (grad.touched[written] == 1).all()
