import numpy as np
import torch

from hsslam_node.kernels.field.gradient import gradient
from hsslam_node.kernels.field.layout import PLANE_SETS
from hsslam_node.kernels.field.planes import gather_planes, plane_position_gradient, scatter_planes
from hsslam_node.reference.encodings import tri_plane_features
from tests.node.kernels.marks import touched_chunks


def _cell_m(field, name):
    config = field.layout.config
    fine = {"geometry_fine": config.geometry_fine_cell_m}
    fine["appearance_fine"] = config.appearance_fine_cell_m
    return fine.get(name, config.coarse_cell_m)


def test_gather_scatter_and_slope_are_the_reference(field, close):
    C, low = field.kernel.channels, field.kernel.origin
    low64 = torch.tensor(field.layout.lattice.low, dtype=torch.float64)
    d_out = np.random.default_rng(1).normal(size=C).astype(np.float32)
    for s, name in enumerate(PLANE_SETS):
        planes = [field.reference.block(f"{name}.{axes}") for axes in ("xy", "xz", "yz")]
        for point in field.points(5, seed=s):
            x = torch.from_numpy(point[None].astype(np.float64)).requires_grad_()
            cell_m = _cell_m(field, name)
            first = torch.from_numpy(field.layout.plane_vertices(cell_m)[0])
            expected = tri_plane_features(planes, x, low64, cell_m, first)
            total = (expected[0] * torch.from_numpy(d_out).double()).sum()
            d_params, d_x = torch.autograd.grad(total, (field.reference.params, x))

            p = (point - low)[:, None]
            out, d_p = np.empty((1, C), np.float32), np.zeros((1, 3), np.float32)
            gather_planes(field.params, field.kernel, s, p, 0, out, 0)
            plane_position_gradient(field.params, field.kernel, s, p, 0, d_out[None], 0, d_p)
            grad = gradient(field.kernel)
            scatter_planes(grad, field.kernel, s, p, 0, d_out[None], 0)
            close(out[0], expected.detach()[0])
            close(d_p[0], d_x[0], 1e-3)
            close(grad.values, d_params.numpy())
            chunks = np.unique(np.flatnonzero(grad.values) // 16)
            np.testing.assert_array_equal(touched_chunks(grad), chunks)


def test_the_border_is_clamped(field):
    """Beyond the plane the border value is read, and never memory of another block."""
    C, kernel = field.kernel.channels, field.kernel
    for corner, away in ((kernel.low, np.float32(-10.0)), (kernel.high, np.float32(10.0))):
        border = (corner - kernel.origin)[:, None]
        for s in range(4):
            at, beyond = np.empty((1, C), np.float32), np.empty((1, C), np.float32)
            gather_planes(field.params, kernel, s, border, 0, at, 0)
            gather_planes(field.params, kernel, s, border + away, 0, beyond, 0)
            np.testing.assert_allclose(at, beyond, atol=1e-5)
