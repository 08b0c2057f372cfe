import numpy as np
import pytest
import torch

from hsslam_node.kernels.field.activations import field_activations
from hsslam_node.kernels.field.backward import field_backward
from hsslam_node.kernels.field.forward import field_forward
from hsslam_node.kernels.field.gradient import gradient
from tests.node.kernels.marks import touched_chunks


def _run(field, points, d_sdf, d_rgb, params=None):
    params = field.params if params is None else params
    n = len(points)
    acts, grad = field_activations(field.kernel, n), gradient(field.kernel)
    d_points = np.full((n, 3), np.nan, np.float32)
    field_forward(params, field.kernel, points, n, acts)
    field_backward(params, field.kernel, n, acts, d_sdf, d_rgb, grad, d_points, True)
    return acts, grad, d_points


def _upstream(n, seed=3):
    rng = np.random.default_rng(seed)
    return rng.normal(size=n).astype(np.float32), rng.normal(size=(n, 3)).astype(np.float32)


def _reference(field, points, d_sdf, d_rgb):
    x = torch.from_numpy(points.astype(np.float64)).requires_grad_()
    out = field.reference(x)
    live = out.inside.double()
    total = (out.sdf * torch.from_numpy(d_sdf.astype(np.float64)) * live).sum()
    total = total + (out.color * torch.from_numpy(d_rgb.astype(np.float64)) * live[:, None]).sum()
    d_params, d_points = torch.autograd.grad(total, (field.reference.params, x))
    return d_params.numpy(), d_points.numpy()


def _along_rays(field, count, seed):
    """Samples close to each other on rays, so that many successive ones share a cell of every grid."""
    rng = np.random.default_rng(seed)
    start = np.repeat(field.points(-(-count // 20), seed=seed, reach=0.8), 20, axis=0)[:count]
    step = np.repeat(rng.normal(size=(-(-count // 20), 3)), 20, axis=0)[:count]
    points = start + 0.003 * step * (np.arange(count) % 20)[:, None]
    return points.astype(np.float32)


@pytest.mark.parametrize("where", ["inside", "in and out", "along rays"])
def test_gradients_are_the_reference_block_by_block(field, close, where):
    if where == "along rays":
        points = _along_rays(field, 600, seed=7)
    else:
        points = field.points(600, seed=5, reach=1.0 if where == "inside" else 1.6)
    d_sdf, d_rgb = _upstream(600)
    _, grad, d_points = _run(field, points, d_sdf, d_rgb)
    expected, expected_points = _reference(field, points, d_sdf, d_rgb)
    for block in field.layout.blocks.values():
        if block.name != "log_beta":
            close(block.view(grad.values), block.view(expected), 5e-4)
    close(d_points, expected_points, 2e-3)


def test_distance_alone_leaves_the_appearance_alone(field):
    d_sdf, d_rgb = _upstream(50)
    _, grad, _ = _run(field, field.points(50), d_sdf, np.zeros_like(d_rgb))
    for name in ("appearance_coarse.xy", "appearance_fine.yz", "color_decoder.W2"):
        assert not field.layout.blocks[name].view(grad.values).any()


def test_touched_chunks_hold_the_whole_gradient(field):
    d_sdf, d_rgb = _upstream(100)
    _, grad, _ = _run(field, field.points(100), d_sdf, d_rgb)
    chunks = grad.values.reshape(-1, 16)
    written = np.flatnonzero(chunks.any(axis=1))
    found = np.union1d(touched_chunks(grad), np.arange(*grad.unmarked))
    assert len(written) and np.isin(written, found).all()
    assert len(touched_chunks(grad)) < 0.9 * len(chunks)  # sparse


def test_gradients_add_up(field, close):
    d_sdf, d_rgb = _upstream(40)
    points = field.points(40)
    _, once, _ = _run(field, points, d_sdf, d_rgb)
    acts = field_activations(field.kernel, 40)
    grad = gradient(field.kernel)
    field_forward(field.params, field.kernel, points, 40, acts)
    for _ in range(2):
        field_backward(
            field.params, field.kernel, 40, acts, d_sdf, d_rgb, grad, np.zeros((0, 3), np.float32),
            False,
        )  # fmt: skip
    close(grad.values, 2 * once.values)


def test_position_gradient_matches_finite_differences(field):
    points = field.points(200, seed=9)
    d_sdf, d_rgb = _upstream(200)
    _, _, d_points = _run(field, points, d_sdf, d_rgb)

    def value(p):
        acts, _, _ = _run(field, p, d_sdf, d_rgb)
        return acts.sdf * d_sdf + (acts.rgb * d_rgb).sum(axis=1)

    step = 2e-5  # m, a thousandth of the finest cell
    for axis in range(3):
        offset = np.zeros(3, np.float32)
        offset[axis] = step
        slope = (value(points + offset) - value(points - offset)) / (2 * step)
        error = np.abs(slope - d_points[:, axis])
        scale = np.abs(d_points[:, axis]).mean()
        assert np.median(error) < 0.02 * scale


def test_parameter_gradient_matches_finite_differences(field):
    points = field.points(100, seed=11)
    d_sdf, d_rgb = _upstream(100)
    _, grad, _ = _run(field, points, d_sdf, d_rgb)
    direction = np.sign(grad.values)  # every parameter moves uphill

    def value(step):
        acts, _, _ = _run(field, points, d_sdf, d_rgb, field.params + np.float32(step) * direction)
        return float((acts.sdf.astype(np.float64) * d_sdf).sum() + (acts.rgb * d_rgb).sum())

    slope = (value(3e-5) - value(-3e-5)) / 6e-5
    assert slope == pytest.approx(float(np.abs(grad.values).sum()), rel=0.02)


def test_empty_batch_is_nothing(field):
    none = np.zeros((0, 3), np.float32)
    _, grad, _ = _run(field, none, np.zeros(0, np.float32), none)
    assert not grad.values.any()
