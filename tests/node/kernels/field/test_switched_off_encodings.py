"""A field without planes, hash grid or one-blob, or with more of one: kernels and reference agree."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from hsslam_node.config import FieldConfig
from hsslam_node.kernels.field.activations import field_activations
from hsslam_node.kernels.field.backward import field_backward
from hsslam_node.kernels.field.forward import field_forward
from hsslam_node.kernels.field.gradient import gradient
from hsslam_node.kernels.field.sdf_query import query_sdf
from tests.node.kernels.conftest import Field, field_of

FULL = FieldConfig(plane_channels=16, hash_table_log2=13)
SWITCHED_OFF = {
    "hash grid and one-blob": replace(FULL, plane_channels=0),
    "planes only": replace(FULL, plane_channels=32, hash_levels=0, oneblob_bins=0),
    "hash grid only": replace(FULL, plane_channels=0, oneblob_bins=0),
    "no hash grid": replace(FULL, hash_levels=0),
    "no one-blob": replace(FULL, oneblob_bins=0),
    "twice the hash features": replace(FULL, plane_channels=0, oneblob_bins=0, hash_features=4),
    "twice the channels": replace(FULL, plane_channels=64, hash_levels=0, oneblob_bins=0),
    "dense grid and planes": replace(
        FULL, oneblob_bins=0, hash_levels=4, hash_features=4, hash_finest_cell_m=0.1
    ),
}
N = 600


@pytest.fixture(scope="module", params=SWITCHED_OFF.values(), ids=SWITCHED_OFF.keys())
def partial_field(request) -> Field:
    return field_of(request.param)


def _by_kernels(field: Field, points, d_sdf, d_rgb):
    acts, grad = field_activations(field.kernel, N), gradient(field.kernel)
    d_points = np.full((N, 3), np.nan, np.float32)
    field_forward(field.params, field.kernel, points, N, acts)
    field_backward(field.params, field.kernel, N, acts, d_sdf, d_rgb, grad, d_points, True)
    return acts, grad, d_points


def test_forward_and_backward_are_the_reference(partial_field, close):
    field = partial_field
    points = field.points(N, seed=5, reach=1.2)
    rng = np.random.default_rng(3)
    d_sdf, d_rgb = rng.normal(size=N), rng.normal(size=(N, 3))
    x = torch.from_numpy(points.astype(np.float64)).requires_grad_()
    out = field.reference(x)
    live = out.inside.double()
    total = (out.sdf * torch.from_numpy(d_sdf) * live).sum()
    total = total + (out.color * torch.from_numpy(d_rgb) * live[:, None]).sum()
    d_params, d_x = torch.autograd.grad(total, (field.reference.params, x))

    acts, grad, d_points = _by_kernels(
        field, points, d_sdf.astype(np.float32), d_rgb.astype(np.float32)
    )
    inside = out.inside.numpy()
    close(acts.sdf[inside], out.sdf.detach().numpy()[inside])
    close(acts.rgb[inside], out.color.detach().numpy()[inside])
    compared = 0
    for block in field.layout.blocks.values():
        if block.name != "log_beta" and block.size:
            close(block.view(grad.values), block.view(d_params.numpy()), 5e-4)
            compared += block.size
    assert compared > 0.9 * field.layout.parameter_count
    close(d_points, d_x.numpy(), 2e-3)


def test_distance_query_is_the_reference(partial_field, close):
    field = partial_field
    points = field.points(N, seed=6)
    sdf, inside = np.zeros(N, np.float32), np.zeros(N, np.uint8)
    slope = np.zeros((N, 3), np.float32)
    query_sdf(field.params, field.kernel, points, sdf, inside, slope, True)
    x = torch.from_numpy(points.astype(np.float64)).requires_grad_()
    expected = field.reference.sdf(x)
    (expected_slope,) = torch.autograd.grad(expected.sum(), x)
    assert inside.all()
    close(sdf, expected.detach().numpy())
    close(slope, expected_slope.numpy(), 1e-3)


def test_only_what_is_there_takes_memory():
    sizes = {name: field_of(c).layout.size_bytes_by_part() for name, c in SWITCHED_OFF.items()}
    assert not any("planes" in part or "_coarse" in part for part in sizes["hash grid only"])
    assert "hash" not in sizes["planes only"] and "hash" in sizes["no one-blob"]
    decoder = {name: size["geometry_decoder"] for name, size in sizes.items()}
    assert decoder["hash grid and one-blob"] - decoder["hash grid only"] == 4 * 48 * 32
