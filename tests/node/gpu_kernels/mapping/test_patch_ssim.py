import numpy as np
import pytest
import torch

from hsslam_node.gpu_kernels.mapping.patch_ssim import patch_ssim_backward
from hsslam_node.mapping.step_inputs import random_patches, window_rays, window_weights
from hsslam_node.reference.losses import patch_loss
from tests.node.gpu_kernels.conftest import empty, on_device


def _kernel(color, measured, windows, count, weight, scale):
    d_color, loss = empty(*color.shape), empty(1)  # the kernel adds to the first
    patch_ssim_backward(
        on_device(color), on_device(measured), on_device(windows.astype(np.int32)),
        on_device(np.array([count], np.int32)), on_device(weight), scale, d_color, loss,
    )  # fmt: skip
    return float(loss[0]), (d_color - 7.0).cpu().numpy()


@pytest.mark.parametrize(("seed", "kernel", "stride"), [(0, 3, 4), (1, 4, 4), (2, 3, 2)])
def test_loss_and_gradient_are_the_reference(close, seed, kernel, stride):
    rng = np.random.default_rng(seed)
    color, measured = rng.random((2, 290, 3)).astype(np.float32)
    patches = torch.from_numpy(random_patches(290, 3, rng))
    x = torch.from_numpy(color.astype(np.float64)).requires_grad_()
    reference = patch_loss(
        x, torch.from_numpy(measured.astype(np.float64)), patches, kernel, stride
    )
    (expected,) = torch.autograd.grad(300.0 * reference, x)
    windows = window_rays(patches, kernel, stride).numpy()
    weight = window_weights(kernel).numpy().astype(np.float32)
    # room for more windows, filled with what must not be read
    padded = np.concatenate([windows, np.full((9, windows.shape[1]), 10**6)])
    loss, d_color = _kernel(color, measured, padded, len(windows), weight, 300.0)
    assert loss == pytest.approx(float(reference.detach()), rel=1e-4)
    close(d_color, expected.numpy())


def test_no_window_is_zero():
    color = np.ones((4, 3), np.float32)
    weight = np.full(9, 1 / 9, np.float32)
    for windows in (np.zeros((0, 9), np.int64), np.zeros((5, 9), np.int64)):
        loss, d_color = _kernel(color, color, windows, 0, weight, 1.0)
        assert loss == 0.0 and not d_color.any()
