"""Samples and pose gradients against the CPU twins and the reference sampling."""

import numpy as np
import pytest

from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.gpu_kernels.mapping.ray_batch import GpuRays, place_samples, pose_gradients
from hsslam_node.kernels.mapping import ray_batch as cpu
from hsslam_node.mapping.ray_batch import ray_batch
from hsslam_node.rendering.ray_sampling import SamplingPattern, sample_rays
from tests.node.gpu_kernels.conftest import empty, on_device

T, R, SLOTS = 0.06, 21, 3


def _batch(seed):
    rng = np.random.default_rng(seed)
    rays = ray_batch(R)
    rays.direction[:] = np.concatenate([rng.uniform(-0.6, 0.6, (R, 2)), np.ones((R, 1))], axis=1)
    rays.depth[:] = rng.uniform(0.05, 4.0, R)  # the nearest reach behind the camera
    rays.slot[:] = rng.integers(0, SLOTS, R)
    poses = np.stack([se3_exp(rng.normal(0, 0.5, 6))[:3] for _ in range(SLOTS)]).astype(np.float32)
    direction, depth, color, slot = (on_device(x) for x in rays)
    return rays, GpuRays(direction, depth, color, slot.int()), poses


@pytest.mark.parametrize(("seed", "free", "surface"), [(0, 8, 4), (1, 3, 9), (2, 5, 0), (3, 0, 5)])
def test_samples_are_those_of_reference_and_twin(seed, free, surface):
    rays, gpu, poses = _batch(seed)
    pattern = SamplingPattern(free, surface)
    S, count = pattern.count, R - 4
    rng = np.random.default_rng(seed + 10)
    jitter = np.concatenate([rng.random((R, free)), rng.random((R, surface))], 1)
    jitter = jitter.astype(np.float32)
    z, points = empty(R, S), empty(R * S, 3)
    counted = on_device(np.array([count], np.int32))
    place_samples(
        gpu, counted, on_device(poses), on_device(jitter), free, surface, 1.2, 1.5 * T, z, points
    )
    expected = sample_rays(rays.depth, pattern, T, 5.0, np.random.default_rng(seed + 10))
    np.testing.assert_allclose(z.cpu().numpy()[:count], expected[:count], atol=1e-5)
    twin_z, twin_points = np.empty((R, S), np.float32), np.empty((R * S, 3), np.float32)
    cpu.place_samples(
        rays, R, poses, jitter, free, surface, np.float32(1.2), np.float32(1.5 * T), twin_z,
        twin_points,
    )  # fmt: skip
    np.testing.assert_allclose(
        points.cpu().numpy()[: count * S], twin_points[: count * S], atol=1e-5
    )
    assert np.isnan(points.cpu().numpy()[count * S :]).all() and np.isfinite(z.cpu().numpy()).all()


def test_pose_gradients_are_those_of_the_twin(close):
    rays, gpu, poses = _batch(5)
    rng = np.random.default_rng(6)
    S, count = 11, R - 2
    z = np.sort(rng.uniform(0, 4, (R, S)), axis=1).astype(np.float32)
    pull = rng.normal(size=(R * S, 3)).astype(np.float32)
    expected = np.zeros((SLOTS, 6), np.float32)
    cpu.pose_gradients(rays, count, poses, z, pull, expected)
    d_twist = empty(SLOTS, 6)  # the kernel adds
    pose_gradients(
        gpu, on_device(np.array([count], np.int32)), on_device(poses), on_device(z),
        on_device(pull), d_twist,
    )  # fmt: skip
    close(d_twist.cpu().numpy() - 7.0, expected)
