"""Rendering and losses against the float64 reference, and against the CPU twin where it does more."""

import numpy as np
import pytest
import torch

from hsslam_node.gpu_kernels.mapping.losses import losses_backward
from hsslam_node.gpu_kernels.mapping.rendering import render_forward
from hsslam_node.kernels.mapping import rendering as cpu
from tests.node.gpu_kernels.conftest import empty, on_device
from tests.node.kernels.mapping.test_rendering import (
    BETA,
    WEIGHT,
    T,
    random_rays,
    rays_by_reference,
)


def _kernel(f, inside, ray_weight=None, count=None, free_sdf=1.0):
    R, S = f["z"].shape
    t = {name: on_device(value) for name, value in f.items()}
    mask, log_beta = on_device(inside), on_device(np.log([BETA]).astype(np.float32))
    weights, color, depth, opacity = empty(R, S), empty(R, 3), empty(R), empty(R)
    render_forward(t["sdf"], t["rgb"], mask, t["z"], log_beta, weights, color, depth, opacity)
    trust = on_device(np.ones(R, np.float32) if ray_weight is None else ray_weight)
    counted = on_device(np.array([R if count is None else count], np.int32))
    d_sdf, d_rgb, ray_loss, terms = empty(R, S), empty(R, S, 3), empty(R), empty(5)
    d_log_beta = empty(1)  # the kernel adds
    losses_backward(
        t["sdf"], t["rgb"], mask, t["z"], log_beta, weights, color, depth, t["measured_color"],
        t["measured_depth"], trust, on_device(WEIGHT), T, free_sdf, t["extra"], counted, d_sdf, d_rgb,
        ray_loss, terms, d_log_beta,
    )  # fmt: skip
    rendered = [x.cpu().numpy() for x in (weights, color, depth, opacity)]
    gradients = [x.cpu().numpy() for x in (d_sdf, d_rgb, d_log_beta - 7.0)]
    return rendered, terms.cpu().numpy(), gradients, ray_loss.cpu().numpy()


@pytest.mark.parametrize(
    ("seed", "S", "free_sdf"), [(1, 12, 1.0), (1, 12, 0.3), (2, 16, 1.0), (3, 1, 1.0)]
)
def test_rays_are_the_reference(close, seed, S, free_sdf):
    f, inside = random_rays(37, S, seed)
    rendered, terms, (d_sdf, d_rgb, d_log_beta), _ = _kernel(f, inside, free_sdf=free_sdf)
    out, expected, (e_sdf, e_rgb, e_log_beta) = rays_by_reference(f, inside, free_sdf)
    for actual, name in zip(rendered, ("weights", "color", "depth", "opacity"), strict=True):
        close(actual, getattr(out, name).detach().numpy())
    np.testing.assert_allclose(terms, expected, rtol=1e-4)
    close(d_sdf, e_sdf)
    close(d_rgb, e_rgb)
    assert d_log_beta[0] == pytest.approx(float(e_log_beta), rel=1e-4, abs=1e-4)
    assert not d_sdf[inside == 0].any() and not d_rgb[inside == 0].any()
    assert rendered[3][3] == 0.0  # the ray that sees nothing


def test_ray_weights_and_ray_losses_are_the_twin(close):
    f, inside = random_rays(37, 12, 4)
    R, S = f["z"].shape
    ray_weight = np.random.default_rng(5).uniform(0.1, 1.0, R).astype(np.float32)
    rendered, terms, (d_sdf, d_rgb, _), ray_loss = _kernel(f, inside, ray_weight)
    e_sdf, e_rgb = np.empty((R, S), np.float32), np.empty((R, S, 3), np.float32)
    e_loss, e_terms = np.empty(R, np.float32), np.empty(5)
    weights, color, depth, _ = rendered
    cpu.losses_backward(
        f["sdf"], f["rgb"], inside, f["z"], BETA, weights, color, depth, f["measured_color"],
        f["measured_depth"], ray_weight, WEIGHT, T, 1.0, f["extra"], R,
        np.count_nonzero(f["measured_depth"]), e_sdf, e_rgb, e_loss, e_terms,
    )  # fmt: skip
    close(ray_loss, e_loss)
    close(terms, e_terms)
    close(d_sdf, e_sdf, 2e-4)  # two float32 results
    close(d_rgb, e_rgb)


def test_rays_beyond_the_count_are_not_there(close):
    f, inside = random_rays(37, 12, 6)
    part = {name: value[:20] for name, value in f.items()}
    _, terms, (d_sdf, d_rgb, d_log_beta), ray_loss = _kernel(f, inside, count=20)
    _, e_terms, (e_sdf, e_rgb, e_log_beta), e_loss = _kernel(part, inside[:20])
    close(terms, e_terms)
    close(d_sdf[:20], e_sdf)
    close(d_rgb[:20], e_rgb)
    close(ray_loss[:20], e_loss)
    close(d_log_beta, e_log_beta)
    assert not d_sdf[20:].any() and not d_rgb[20:].any() and not ray_loss[20:].any()


def test_weights_of_thin_media_keep_their_digits(close):
    f, inside = random_rays(8, 12, 7)
    f["sdf"][:] = np.random.default_rng(7).uniform(0.8, 1.0, (8, 12))  # sigma about 1e-3
    (weights, *_), _, _, _ = _kernel(f, inside)
    out, _, _ = rays_by_reference(f, inside)
    close(weights, out.weights.detach().numpy(), 1e-6)
    assert torch.finfo(torch.float32).eps < weights[inside == 1].max() < 0.1
