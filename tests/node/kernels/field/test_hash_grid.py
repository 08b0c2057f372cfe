import numpy as np
import pytest
import torch

from hsslam_node.kernels.field.gradient import gradient
from hsslam_node.kernels.field.hash_grid import gather_hash, hash_position_gradient, scatter_hash


def test_gather_scatter_and_slope_are_the_reference(field, close):
    d_out = np.random.default_rng(1).normal(size=32).astype(np.float32)
    for point in field.points(10, seed=8):
        x = torch.from_numpy(point[None].astype(np.float64)).requires_grad_()
        expected = field.reference.hash_feature(x)
        total = (expected[0] * torch.from_numpy(d_out).double()).sum()
        d_params, d_x = torch.autograd.grad(total, (field.reference.params, x))

        p = (point - field.kernel.origin)[:, None].copy()
        out, d_p = np.empty((16, 1, 2), np.float32), np.zeros((1, 3), np.float32)
        gather_hash(field.params, field.kernel, p, 1, out)
        d_features = d_out.reshape(16, 1, 2)
        hash_position_gradient(field.params, field.kernel, p, 1, d_features, d_p)
        grad = gradient(field.kernel)
        scatter_hash(grad, field.kernel, p, 1, d_features)
        close(out.ravel(), expected.detach()[0])
        close(d_p[0], d_x[0], 1e-3)
        close(grad.values, d_params.numpy())
        chunks = np.flatnonzero(grad.values) // 16
        assert (chunks >= grad.unmarked[0]).all() and (chunks < grad.unmarked[1]).all()


@pytest.mark.parametrize("name", ["low", "high"])
def test_the_corners_are_inside_the_tables(field, close, name):
    corner = torch.tensor([getattr(field.layout.bound, name)], dtype=torch.float64)
    out = np.empty((16, 1, 2), np.float32)
    at = getattr(field.kernel, name) - field.kernel.origin
    gather_hash(field.params, field.kernel, at[:, None].copy(), 1, out)
    close(out.ravel(), field.reference.hash_feature(corner).detach()[0], 1e-3)
