"""Points and normals of a depth image against NumPy."""

import numpy as np

from hsslam_node.kernels.tracking.depth_points import surface_of_depth

K = np.array([70.0, 72.0, 39.0, 30.5])


def test_points_and_normals_are_those_of_the_reference():
    rng = np.random.default_rng(0)
    depth = rng.uniform(1.0, 3.0, (30, 40)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.1] = 0
    points = np.full((30, 40, 3), np.nan, np.float32)
    normals = np.full_like(points, np.nan)
    surface_of_depth(depth, K, points, normals)
    expected_points, expected_normals = _reference(depth.astype(np.float64))
    np.testing.assert_allclose(points, expected_points, atol=1e-5)
    np.testing.assert_allclose(normals, expected_normals, atol=1e-4)
    assert 0.4 < (np.abs(normals).sum(-1) > 0).mean() < 0.7


def _reference(depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    v, u = np.mgrid[: depth.shape[0], : depth.shape[1]]
    points = np.stack([(u - K[2]) / K[0] * depth, (v - K[3]) / K[1] * depth, depth], -1)
    du, dv = np.zeros_like(points), np.zeros_like(points)
    du[:, 1:-1] = points[:, 2:] - points[:, :-2]
    dv[1:-1] = points[2:] - points[:-2]
    normals = np.cross(dv, du)
    known = np.zeros(depth.shape, bool)
    has = depth > 0
    known[1:-1, 1:-1] = (
        has[1:-1, 1:-1] & has[1:-1, 2:] & has[1:-1, :-2] & has[2:, 1:-1] & has[:-2, 1:-1]
    )
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    return points, np.where(known[..., None], normals / np.maximum(length, 1e-12), 0)
