"""Sparse Adam against the CPU twin, which is tested against torch.optim."""

import numpy as np

from hsslam_node.gpu_kernels.field.activations import Gradient
from hsslam_node.gpu_kernels.mapping.adam import sparse_adam
from hsslam_node.kernels.field.gradient import Gradient as CpuGradient
from hsslam_node.kernels.mapping import adam as cpu
from tests.node.gpu_kernels.conftest import on_device
from tests.node.kernels.marks import touch, touched_chunks

P = 80 * 16  # chunks: more than a block, not a multiple of it
RATES = np.array([[0, 640, 1e-2], [640, 1136, 1e-3]])  # the last chunks lie in no region


def test_steps_are_those_of_the_twin(close):
    rng = np.random.default_rng(0)
    params = rng.normal(size=P).astype(np.float32)
    start = params.copy()
    moments, stepped_at = np.zeros((2, P), np.float32), np.zeros(P // 16, np.int32)
    page_stepped_at = np.zeros(2, np.int32)
    grad = CpuGradient(np.zeros(P, np.float32), np.zeros(2, np.uint64), np.zeros(2, np.int64))
    marks = np.zeros(P // 16, np.uint8)
    gpu = [on_device(x) for x in (params, moments[0], moments[1])]
    gpu_grad = Gradient(on_device(grad.values), on_device(marks))
    gpu_stepped = on_device(stepped_at)
    for step in [*range(1, 9), 1000]:
        g = rng.normal(size=(P // 16, 16)).astype(np.float32)
        g *= 10.0 ** rng.uniform(-8, 2, (P // 16, 1)).astype(np.float32)
        touched = rng.random(P // 16) < 0.3
        grad.values.reshape(-1, 16)[touched], marks[touched] = g[touched], 1
        touch(grad, np.flatnonzero(touched))
        gpu_grad.values.copy_(on_device(grad.values))
        gpu_grad.touched.copy_(on_device(marks))
        cpu.sparse_adam(
            params, *moments, grad, step, RATES, 1e-15, 0.9, 0.99, stepped_at, page_stepped_at,
            0, 1,
        )  # fmt: skip
        sparse_adam(
            *gpu, gpu_grad, on_device(np.array([step], np.int32)), on_device(RATES), 1e-15, 0.9,
            0.99, gpu_stepped,
        )  # fmt: skip
        close(gpu[0].cpu().numpy() - start, params - start)
        close(gpu[1].cpu().numpy(), moments[0])
        close(gpu[2].cpu().numpy(), moments[1])
        np.testing.assert_array_equal(gpu_stepped.cpu().numpy(), stepped_at)
        marks[:71] = 0  # what was stepped
        np.testing.assert_array_equal(touched_chunks(grad), np.flatnonzero(marks))
        np.testing.assert_array_equal(gpu_grad.touched.cpu(), marks)
        np.testing.assert_array_equal(gpu_grad.values.cpu(), grad.values)
    assert len(set(stepped_at.tolist())) > 4  # lazy: chunks moved at different steps
    assert marks.any()
    np.testing.assert_array_equal(gpu[0].cpu()[1136:], start[1136:])
