import numpy as np
import torch

from hsslam_node.kernels.hash_grid import gather_hash, hash_position_gradient, scatter_hash


def test_gather_scatter_and_slope_are_the_reference(field, close):
    d_out = np.random.default_rng(1).normal(size=32).astype(np.float32)
    for point in field.points(10, seed=8):
        x = torch.from_numpy(point[None].astype(np.float64)).requires_grad_()
        expected = field.reference.hash_feature(x)
        total = (expected[0] * torch.from_numpy(d_out).double()).sum()
        d_params, d_x = torch.autograd.grad(total, (field.reference.params, x))

        p = (point - field.kernel.low)[None]
        out, d_p = np.empty((1, 32), np.float32), np.zeros((1, 3), np.float32)
        gather_hash(field.params, field.kernel, p, out)
        hash_position_gradient(field.params, field.kernel, p, d_out[None], d_p)
        grad = np.zeros_like(field.params)
        touched = np.zeros(len(grad) // 16 + 8, np.uint8)
        scatter_hash(grad, touched, field.kernel, p, d_out[None])
        close(out[0], expected.detach()[0])
        close(d_p[0], d_x[0], 1e-3)
        close(grad, d_params.numpy())
        assert touched[np.flatnonzero(grad) // 16].all()


def test_the_far_corner_is_inside_the_tables(field, close):
    corner = torch.tensor([field.layout.bound.high], dtype=torch.float64)
    out = np.empty((1, 32), np.float32)
    extent = field.layout.bound.extent_m.astype(np.float32)
    gather_hash(field.params, field.kernel, extent[None], out)
    close(out[0], field.reference.hash_feature(corner).detach()[0], 1e-3)
