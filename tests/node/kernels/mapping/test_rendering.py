import numpy as np
import pytest
import torch

from hsslam_node.kernels.mapping.rendering import losses_backward, render_forward
from hsslam_node.reference.losses import color_loss, depth_loss, free_space_loss, sdf_losses
from hsslam_node.reference.rendering import render_rays

T, BETA = 0.06, 9.0
WEIGHT = np.array([5.0, 0.1, 200.0, 10.0, 5.0], np.float32)


def random_rays(R=40, S=12, seed=0):
    rng = np.random.default_rng(seed)
    f = {"measured_depth": rng.uniform(1.0, 2.0, R)}
    f["measured_depth"][::5] = 0.0  # no measurement
    z = np.sort(rng.uniform(-0.25, 0.12, (R, S)) + np.maximum(f["measured_depth"], 1)[:, None], 1)
    f |= {"z": z, "sdf": rng.uniform(-1, 1, (R, S)), "rgb": rng.random((R, S, 3))}
    f["measured_color"] = rng.random((R, 3))
    f["extra"] = rng.normal(size=(R, 3))
    f = {name: value.astype(np.float32) for name, value in f.items()}
    inside = rng.random((R, S)) > 0.1
    inside[3] = False  # a ray that sees nothing
    return f, inside.astype(np.uint8)


def rays_by_reference(f, inside, free_sdf=1.0):
    t = {name: torch.from_numpy(value.astype(np.float64)) for name, value in f.items()}
    sdf, rgb = t["sdf"].requires_grad_(), t["rgb"].requires_grad_()
    log_beta = torch.tensor(np.log(BETA), dtype=torch.float64, requires_grad=True)
    mask = torch.from_numpy(inside.astype(bool))
    out = render_rays(sdf, rgb, t["z"], log_beta.exp(), mask)
    middle, tail = sdf_losses(sdf, t["z"], t["measured_depth"], mask, T)
    terms = torch.stack(
        [
            color_loss(out.color, t["measured_color"]),
            depth_loss(out.depth, t["measured_depth"]),
            middle,
            tail,
            free_space_loss(sdf, t["z"], t["measured_depth"], mask, T, free_sdf),
        ]
    )
    total = (terms * torch.from_numpy(WEIGHT).double()).sum() + (out.color * t["extra"]).sum()
    return out, terms.detach().numpy(), torch.autograd.grad(total, (sdf, rgb, log_beta))


def _kernel(f, inside, free_sdf=1.0):
    R, S = f["z"].shape
    weights, color = np.empty((R, S), np.float32), np.empty((R, 3), np.float32)
    depth, opacity = np.empty(R, np.float32), np.empty(R, np.float32)
    render_forward(f["sdf"], f["rgb"], inside, f["z"], BETA, weights, color, depth, opacity)
    d_sdf, d_rgb = np.empty((R, S), np.float32), np.empty((R, S, 3), np.float32)
    ray_loss, terms = np.empty(R, np.float32), np.empty(5, np.float64)
    d_log_beta = losses_backward(
        f["sdf"], f["rgb"], inside, f["z"], BETA, weights, color, depth, f["measured_color"],
        f["measured_depth"], np.ones(R, np.float32), WEIGHT, T, free_sdf, f["extra"], R,
        np.count_nonzero(f["measured_depth"]), d_sdf, d_rgb, ray_loss, terms,
    )  # fmt: skip
    return (weights, color, depth, opacity), terms, (d_sdf, d_rgb, d_log_beta), ray_loss


def test_rendering_is_the_reference(close):
    f, inside = random_rays()
    rendered, _, _, _ = _kernel(f, inside)
    out, _, _ = rays_by_reference(f, inside)
    for actual, name in zip(rendered, ("weights", "color", "depth", "opacity"), strict=True):
        close(actual, getattr(out, name).detach().numpy(), 1e-5)
    assert rendered[3][3] == 0.0


@pytest.mark.parametrize("free_sdf", [1.0, 0.3])
def test_losses_and_gradients_are_the_reference(close, free_sdf):
    f, inside = random_rays()
    _, terms, (d_sdf, d_rgb, d_log_beta), ray_loss = _kernel(f, inside, free_sdf)
    _, expected, (e_sdf, e_rgb, e_log_beta) = rays_by_reference(f, inside, free_sdf)
    np.testing.assert_allclose(terms, expected, rtol=1e-4)
    close(d_sdf, e_sdf, 2e-4)
    close(d_rgb, e_rgb, 1e-4)
    assert d_log_beta == pytest.approx(float(e_log_beta), rel=1e-3)
    assert not d_sdf[inside == 0].any()
    assert np.isfinite(ray_loss).all() and (ray_loss >= 0).all()


def test_losses_of_the_rays_average_to_the_total():
    f, inside = random_rays()
    f["measured_depth"] = np.maximum(f["measured_depth"], 1.0)  # all rays count the same
    _, terms, _, ray_loss = _kernel(f, inside)
    assert ray_loss.mean() == pytest.approx(float(terms @ WEIGHT), rel=1e-4)


def test_nothing_to_supervise_is_zero():
    f, inside = random_rays()
    f["measured_depth"][:] = 0.0
    f["extra"][:] = 0.0
    f["measured_color"][:] = _kernel(f, inside)[0][1]
    _, terms, (d_sdf, d_rgb, _), _ = _kernel(f, inside)
    assert not terms.any() and not d_sdf.any() and not d_rgb.any()
