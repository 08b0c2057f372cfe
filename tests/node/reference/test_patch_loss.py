import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter

from hsslam_node.mapping.step_inputs import random_patches
from hsslam_node.reference.losses import patch_loss


def _patches(rays, repeats=3, seed=0):
    return torch.from_numpy(random_patches(rays, repeats, np.random.default_rng(seed)))


def test_too_few_rays_give_zero():
    patches = _patches(16 * 16 - 1)
    assert len(patches) == 0
    color = torch.rand(255, 3, requires_grad=True)
    loss = patch_loss(color, torch.rand(255, 3), patches)
    loss.backward()
    assert float(loss.detach()) == 0.0


def test_equal_images_cost_nothing_and_opposite_ones_much():
    color = torch.rand(400, 3, dtype=torch.float64)
    patches = _patches(400)
    assert float(patch_loss(color, color, patches)) == pytest.approx(0.0, abs=1e-12)
    assert float(patch_loss(1 - color, color, patches)) > 0.8


def test_value_is_the_gaussian_ssim_at_the_window_centres():
    side = 21
    a, b = np.random.default_rng(1).random((2, side, side, 3))
    order = torch.arange(side * side).reshape(1, side, side)

    def mean(image):  # 3x3 window, sigma 1.5 px, at every fourth pixel
        return gaussian_filter(image, 1.5, radius=1, axes=(0, 1))[1:-1:4, 1:-1:4]

    m_a, m_b, c1, c2 = mean(a), mean(b), 0.01**2, 0.03**2
    v_a, v_b, cov = mean(a * a) - m_a**2, mean(b * b) - m_b**2, mean(a * b) - m_a * m_b
    ssim = (2 * m_a * m_b + c1) * (2 * cov + c2) / ((m_a**2 + m_b**2 + c1) * (v_a + v_b + c2))
    flat_a, flat_b = (torch.from_numpy(v.reshape(-1, 3)) for v in (a, b))
    assert float(patch_loss(flat_a, flat_b, order)) == pytest.approx(1 - ssim.mean(), abs=1e-9)


def test_gradient_matches_finite_differences():
    color = torch.rand(256, 3, dtype=torch.float64, requires_grad=True)
    measured, patches = torch.rand(256, 3, dtype=torch.float64), _patches(256, repeats=1)
    assert torch.autograd.gradcheck(lambda c: patch_loss(c, measured, patches), (color,))
