import numpy as np
import pytest
import torch

from hsslam_node.kernels.mapping.patch_ssim import patch_ssim_backward
from hsslam_node.mapping.step_inputs import random_patches, window_rays, window_weights
from hsslam_node.reference.losses import patch_loss


@pytest.mark.parametrize(("kernel", "stride"), [(3, 4), (4, 4), (3, 2)])
def test_loss_and_gradient_are_the_reference(close, kernel, stride):
    rng = np.random.default_rng(0)
    color, measured = rng.random((2, 450, 3)).astype(np.float32)
    patches = torch.from_numpy(random_patches(450, 4, rng))
    x = torch.from_numpy(color.astype(np.float64)).requires_grad_()
    loss = patch_loss(x, torch.from_numpy(measured.astype(np.float64)), patches, kernel, stride)
    (expected,) = torch.autograd.grad(0.5 * loss, x)

    windows = window_rays(patches, kernel, stride).numpy()
    weight = window_weights(kernel).numpy().astype(np.float32)
    d_color = np.ones_like(color)  # the kernel adds
    value = patch_ssim_backward(color, measured, windows, weight, np.float32(0.5), d_color)
    assert value == pytest.approx(float(loss.detach()), abs=1e-5)
    close(d_color - 1.0, expected.numpy(), 2e-3)


def test_no_window_is_zero():
    d_color = np.zeros((4, 3), np.float32)
    none, color = np.zeros((0, 9), np.int64), np.ones((4, 3), np.float32)
    weight = np.full(9, 1 / 9, np.float32)
    assert patch_ssim_backward(color, color, none, weight, np.float32(1.0), d_color) == 0.0
    assert not d_color.any()
