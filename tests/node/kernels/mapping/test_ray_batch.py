import numpy as np
import pytest

from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.kernels.mapping.ray_batch import gather_pixels, place_samples, pose_gradients
from hsslam_node.mapping.ray_batch import RayBatch, ray_batch
from hsslam_node.rendering.ray_sampling import SamplingPattern, sample_rays

PATTERN, T, R = SamplingPattern(8, 4), 0.06, 30


def _rays(seed=0) -> RayBatch:
    rng = np.random.default_rng(seed)
    rays = ray_batch(R)
    rays.direction[:] = np.concatenate([rng.uniform(-0.6, 0.6, (R, 2)), np.ones((R, 1))], axis=1)
    rays.depth[:] = rng.uniform(0.5, 4.0, R)
    rays.slot[:] = rng.integers(0, 2, R)
    return rays


def _poses():
    poses = [se3_exp(np.array([0.1, -0.2, 0.3, 0.2, 0.5, -0.1])), se3_exp(np.arange(6) * 0.2)]
    return np.stack(poses)


def _place(rays, poses, jitter):
    z = np.empty((R, PATTERN.count), np.float32)
    points = np.empty((R * PATTERN.count, 3), np.float32)
    place_samples(
        rays, R, poses[:, :3].astype(np.float32), jitter, 8, 4, np.float32(1.2),
        np.float32(1.5 * T), z, points,
    )  # fmt: skip
    return z, points


def _jitter(seed=1):
    rng = np.random.default_rng(seed)
    return np.concatenate([rng.random((R, 8)), rng.random((R, 4))], axis=1).astype(np.float32)


def test_samples_are_the_reference():
    rays = _rays()
    z, _ = _place(rays, _poses(), _jitter())
    expected = sample_rays(rays.depth, PATTERN, T, 5.0, np.random.default_rng(1))
    np.testing.assert_allclose(z, expected, atol=1e-5)


def test_points_lie_on_the_rays_at_planar_depth():
    rays, poses = _rays(), _poses()
    z, points = _place(rays, poses, _jitter())
    camera = rays.direction[:, None] * z[..., None]  # [R, S, 3]
    rotation, translation = poses[rays.slot, :3, :3], poses[rays.slot, :3, 3]
    expected = np.einsum("rij,rsj->rsi", rotation, camera) + translation[:, None]
    np.testing.assert_allclose(points.reshape(R, -1, 3), expected, atol=1e-5)


def test_pose_gradient_matches_finite_differences():
    rays, poses, jitter = _rays(), _poses(), _jitter()
    z, points = _place(rays, poses, jitter)
    pull = np.random.default_rng(4).normal(size=points.shape).astype(np.float32)
    d_twist = np.zeros((2, 6), np.float32)
    pose_gradients(rays, R, poses[:, :3].astype(np.float32), z, pull, d_twist)

    def value(slot, twist):  # rotation in world axes about the camera's position
        moved = poses.copy()
        turn = se3_exp(np.concatenate([np.zeros(3), twist[3:]]))[:3, :3]
        moved[slot, :3, :3] = turn @ poses[slot, :3, :3]
        moved[slot, :3, 3] += twist[:3]
        camera = rays.direction[:, None] * z[..., None].astype(np.float64)
        rotation, translation = moved[rays.slot, :3, :3], moved[rays.slot, :3, 3]
        p = np.einsum("rij,rsj->rsi", rotation, camera) + translation[:, None]
        return float((p.reshape(-1, 3) * pull).sum())

    for slot, axis in np.ndindex(2, 6):
        step = np.zeros(6)
        step[axis] = 1e-5
        slope = (value(slot, step) - value(slot, -step)) / 2e-5
        assert d_twist[slot, axis] == pytest.approx(slope, rel=1e-3, abs=1e-3)


def test_pixels_without_depth_are_passed_over():
    rng = np.random.default_rng(0)
    color = rng.integers(0, 256, (20, 30, 3)).astype(np.uint8)
    depth = rng.integers(1000, 4000, (20, 30)).astype(np.uint16)
    depth[:, ::2] = 0
    depth[:, 1] = 9000  # beyond the reach
    uv = np.stack([rng.integers(0, 30, 200), rng.integers(0, 20, 200)], axis=1)
    rays = ray_batch(40)
    K = np.array([25.0, 26.0, 14.5, 9.5], np.float32)
    found = gather_pixels(color, depth, 1e-3, 6.0, K, uv, 0, 0.0, False, 3, rays, 10, 25)
    assert found == 25 and (rays.slot[10:35] == 3).all() and not rays.depth[35:].any()
    d = rays.direction[10:35]
    u = np.rint(d[:, 0] * 25 + 14.5).astype(int)
    v = np.rint(d[:, 1] * 26 + 9.5).astype(int)
    assert (u % 2 == 1).all() and (u != 1).all() and (d[:, 2] == 1).all()
    np.testing.assert_allclose(rays.depth[10:35], depth[v, u] / 1000, rtol=1e-5)
    np.testing.assert_allclose(rays.color[10:35], color[v, u] / 255, rtol=1e-5)


def test_depth_is_the_mean_of_the_inverse_depth_of_pairs_on_the_same_surface():
    rng = np.random.default_rng(1)
    height, width, radius_px, same = 14, 18, 2, 0.01
    inverse = rng.normal(0.5, 0.003, (height, width))
    inverse[:, 9:] += 0.1  # a nearer surface beside it
    depth = np.rint(1e4 / inverse).astype(np.uint16)
    depth[rng.random(depth.shape) < 0.2] = 0
    color = np.zeros((height, width, 3), np.uint8)
    v, u = np.nonzero(depth)
    rays = ray_batch(len(u))
    K = np.array([25.0, 26.0, 8.5, 6.5], np.float32)
    uv = np.stack([u, v], axis=1)
    found = gather_pixels(
        color, depth, 1e-4, 6.0, K, uv, radius_px, same, False, 0, rays, 0, len(u)
    )
    assert found == len(u)
    measured = np.divide(1e4, depth, out=np.zeros(depth.shape), where=depth > 0)
    for k in range(found):
        own, wanted = measured[v[k], u[k]], [measured[v[k], u[k]]]
        for dy, dx in [(0, 1), (0, 2), *((y, x) for y in (1, 2) for x in range(-2, 3))]:
            rows, columns = (v[k] - dy, v[k] + dy), (u[k] - dx, u[k] + dx)
            if min(rows + columns) < 0 or max(rows) >= height or max(columns) >= width:
                continue
            pair = measured[list(rows), list(columns)]
            if (pair > 0).all() and abs(pair.mean() - own) < same:
                wanted += [*pair]
        assert rays.depth[k] == pytest.approx(1 / np.mean(wanted), rel=1e-5)
