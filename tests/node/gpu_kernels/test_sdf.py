"""SDF query and alignment against the float64 reference."""

from dataclasses import replace

import numpy as np
import torch

from hsslam_node.geometry.se3 import inverse, se3_exp
from hsslam_node.gpu_kernels.field.sdf_query import query_sdf
from hsslam_node.gpu_kernels.tracking.alignment import alignment_work_space, sdf_normal_equations
from hsslam_node.kernels.tracking.alignment import add_sdf_term
from hsslam_node.reference.field import HybridField
from tests.node.gpu_kernels.conftest import empty, on_device

N = 150
T, SIGMA, SLOPE = 0.06, 0.005, 0.0019


def _reference(field, points):
    x = torch.from_numpy(points.astype(np.float64)).requires_grad_()
    sdf = field.cpu.reference.sdf(x)
    (slope,) = torch.autograd.grad(sdf.sum(), x)
    return sdf.detach().numpy(), slope.numpy(), field.cpu.reference.inside(x).numpy()


def _steep(field, points):
    """The field with its distances stretched until three in ten of them are outliers."""
    beyond = np.quantile(np.arctanh(np.abs(_reference(field, points)[0])), 0.7)
    params = field.cpu.params.copy()
    field.cpu.layout.blocks["geometry_decoder.W2"].view(params)[...] *= np.arctanh(0.95) / beyond
    reference = HybridField(field.cpu.layout, torch.from_numpy(params.astype(np.float64)))
    cpu = replace(field.cpu, params=params, reference=reference)
    return replace(field, cpu=cpu, params=on_device(params))


def test_distance_and_gradient_are_the_reference(gpu_field, close):
    field = gpu_field
    points = field.cpu.points(N, seed=1, reach=1.2)
    prefix = field.params[: field.cpu.layout.geometry_count].clone()
    sdf, gradient, inside = empty(N), empty(N, 3), empty(N, dtype=torch.uint8)
    query_sdf(prefix, field.layout, on_device(points), sdf, inside, gradient, True)
    expected, slope, within = _reference(field, points)
    np.testing.assert_array_equal(inside.cpu(), within)
    close(sdf.cpu().numpy()[within], expected[within])
    close(gradient.cpu().numpy()[within], slope[within])
    assert (~within).any() and (sdf.cpu().numpy()[~within] == 1).all()
    assert not gradient.cpu().numpy()[~within].any()
    again = empty(N)
    query_sdf(prefix, field.layout, on_device(points), again, inside, gradient, False)
    close(again.cpu().numpy(), sdf.cpu().numpy(), 1e-6)  # another kernel, which rounds by itself


def test_normal_equations_are_the_reference(gpu_field, close):
    world = gpu_field.cpu.points(N, seed=3, reach=1.2).astype(np.float64)
    field = _steep(gpu_field, world)
    pose = se3_exp(np.array([0.1, -0.2, -1.5, 0.1, 0.2, -0.1]))
    T_cam_world = inverse(pose)
    camera = (world @ T_cam_world[:3, :3].T + T_cam_world[:3, 3]).astype(np.float32)
    pose32 = pose.astype(np.float32)
    world = camera.astype(np.float64) @ pose32[:3, :3].T.astype(np.float64) + pose32[:3, 3]
    count = N - 7
    sdf, slope, inside = _reference(field, world[:count])
    used = inside & (np.abs(sdf) <= 0.95)
    ordered = np.sort(np.abs(sdf[used]))
    huber = float(T * ordered[len(ordered) // 2 :][:2].mean())  # half of them beyond, none on it
    expected_H, expected_b = np.zeros((7, 7)), np.zeros(7)
    cost, inliers, seen, squares = add_sdf_term(
        sdf, slope, inside.astype(np.uint8), world[:count], camera[:count, 2].astype(np.float64),
        pose32[:3, 3].astype(np.float64), T, SIGMA, SLOPE, huber, expected_H, expected_b,
    )  # fmt: skip
    expected_H += np.triu(expected_H, 1).T
    H, b = empty(7, 7, dtype=torch.float64), empty(7, dtype=torch.float64)
    sums = empty(4, dtype=torch.float64)
    partial = alignment_work_space(field.layout, N)
    sdf_normal_equations(
        field.params, field.layout, on_device(camera), on_device(np.array([count], np.int32)),
        on_device(pose32[:3]), T, SIGMA, SLOPE, huber, partial, H, b, sums,
    )  # fmt: skip
    assert 9 < inliers < used.sum() - 9 < seen - 18 < count - 27
    assert (int(sums[1]), int(sums[2])) == (inliers, seen)
    close(sums.cpu().numpy()[[0, 3]], [cost, squares])
    close(H.cpu().numpy()[:3, :3], expected_H[:3, :3])
    close(H.cpu().numpy()[:3, 3:6], expected_H[:3, 3:6])
    close(H.cpu().numpy()[3:6, 3:6], expected_H[3:6, 3:6])
    close(b.cpu().numpy()[:3], expected_b[:3])
    close(b.cpu().numpy()[3:6], expected_b[3:6])
    assert not H[6].any() and not H[:, 6].any() and b[6] == 0


def test_no_point_is_no_system(gpu_field):
    field = gpu_field
    H, b = empty(7, 7, dtype=torch.float64), empty(7, dtype=torch.float64)
    sums = empty(4, dtype=torch.float64)
    sdf_normal_equations(
        field.params, field.layout, empty(16, 3), on_device(np.zeros(1, np.int32)), empty(3, 4), T,
        SIGMA, SLOPE, 0.02, alignment_work_space(field.layout, 16), H, b, sums,
    )  # fmt: skip
    assert not H.any() and not b.any() and not sums.any()
