"""The field, forward and backward, against the float64 reference on fresh random inputs."""

import numpy as np
import torch

from hsslam_node.gpu_kernels.field.activations import field_activations, gradient
from hsslam_node.gpu_kernels.field.backward import field_backward
from hsslam_node.gpu_kernels.field.forward import field_forward
from hsslam_node.gpu_kernels.field.pose_backward import field_pose_backward
from tests.node.gpu_kernels.conftest import empty, on_device

N = 70  # not a multiple of the block


def _run(field, points, d_sdf, d_rgb, grad=None):
    """Forward and backward; adds to `grad` if it is given."""
    n = len(points)
    acts, grad = field_activations(field.layout, n), grad or gradient(field.layout)
    d_points = empty(n, 3)
    field_forward(field.params, field.layout, on_device(points), n, acts)
    field_backward(
        field.params,
        field.layout,
        n,
        acts,
        on_device(d_sdf),
        on_device(d_rgb),
        grad,
        d_points,
        True,
    )
    return acts, grad, d_points


def _upstream(n, seed):
    rng = np.random.default_rng(seed)
    return rng.normal(size=n).astype(np.float32), rng.normal(size=(n, 3)).astype(np.float32)


def _reference(field, points, d_sdf, d_rgb):
    x = torch.from_numpy(points.astype(np.float64)).requires_grad_()
    out = field.cpu.reference(x)
    live = out.inside.double()
    total = (out.sdf * torch.from_numpy(d_sdf.astype(np.float64)) * live).sum()
    total = total + (out.color * torch.from_numpy(d_rgb.astype(np.float64)) * live[:, None]).sum()
    d_params, d_points = torch.autograd.grad(total, (field.cpu.reference.params, x))
    return out, d_params.numpy(), d_points.numpy()


def test_field_is_the_reference(gpu_field, close):
    points = gpu_field.cpu.points(N, seed=1, reach=1.2)
    d_sdf, d_rgb = _upstream(N, 1)
    acts, grad, d_points = _run(gpu_field, points, d_sdf, d_rgb)
    out, d_params, expected_points = _reference(gpu_field, points, d_sdf, d_rgb)
    inside = out.inside.numpy()
    assert 10 < inside.sum() < N - 5
    np.testing.assert_array_equal(acts.inside.cpu(), inside)
    sdf, rgb = acts.sdf.cpu().numpy(), acts.rgb.cpu().numpy()
    close(sdf[inside], out.sdf.detach().numpy()[inside])
    close(rgb[inside], out.color.detach().numpy()[inside])
    assert (sdf[~inside] == 1).all() and (rgb[~inside] == 0.5).all()
    values = grad.values.cpu().numpy()
    for block in gpu_field.cpu.layout.blocks.values():
        if block.name != "log_beta" and block.size:
            close(block.view(values), block.view(d_params))
    close(d_points.cpu().numpy(), expected_points)


def test_position_alone_is_the_same_and_leaves_the_parameters(gpu_field):
    n = 40
    points = gpu_field.cpu.points(n, seed=3, reach=1.2)
    d_sdf, d_rgb = _upstream(n, 3)
    _, _, expected = _run(gpu_field, points, d_sdf, d_rgb)
    params = gpu_field.params.clone()
    acts, alone = field_activations(gpu_field.layout, n), empty(n, 3)
    field_forward(params, gpu_field.layout, on_device(points), n, acts)
    field_pose_backward(
        params, gpu_field.layout, n, acts, on_device(d_sdf), on_device(d_rgb), alone
    )
    assert torch.equal(alone, expected) and alone.any()
    assert torch.equal(params, gpu_field.params)


def test_gradients_add_up_and_an_empty_batch_is_nothing(gpu_field, close):
    points = gpu_field.cpu.points(20, seed=4)
    points[3] = np.nan  # outside
    d_sdf, d_rgb = _upstream(20, 4)
    acts, grad, d_points = _run(gpu_field, points, d_sdf, d_rgb)
    once = grad.values.clone()
    written = once.view(-1, 16).any(dim=1)
    assert (grad.touched[written] == 1).all() and grad.touched.float().mean() < 0.9  # sparse
    _run(gpu_field, points, d_sdf, d_rgb, grad)
    close(grad.values.cpu().numpy(), 2 * once.cpu().numpy(), 1e-5)
    assert acts.inside[3] == 0 and not d_points[3].any()
    _, none, _ = _run(gpu_field, points[:0], d_sdf[:0], d_rgb[:0])
    assert not none.values.any()
