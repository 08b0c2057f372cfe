import numpy as np
import pytest

from hsslam_node.distance.kernels.level_points import sum_within, write_points
from hsslam_node.geometry.se3 import se3_exp

RNG = np.random.default_rng(0)
FX, FY, CX, CY = 60.0, 61.0, 31.5, 23.5


def _reference(depth_m, step, T, max_depth_m):
    z = depth_m[::step, ::step].astype(np.float64)
    u = (np.arange(z.shape[1]) * step - CX) / FX
    v = (np.arange(z.shape[0]) * step - CY) / FY
    grid = np.stack([u[None] * z, v[:, None] * z, z], axis=-1)
    right, below = grid[1:-1, 2:] - grid[1:-1, :-2], grid[2:, 1:-1] - grid[:-2, 1:-1]
    normal = np.cross(below, right)
    around = np.stack([z[1:-1, 2:], z[1:-1, :-2], z[2:, 1:-1], z[:-2, 1:-1]])
    middle = z[1:-1, 1:-1]
    is_surface = (middle > 0) & (middle < max_depth_m)
    is_surface &= (np.abs(around - middle) < 0.05 * middle).all(axis=0)
    normal = normal[is_surface]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return grid[1:-1, 1:-1][is_surface] @ T[:3, :3].T + T[:3, 3], normal @ T[:3, :3].T


@pytest.mark.parametrize(("height", "width", "step"), [(48, 64, 1), (49, 63, 2), (50, 65, 3)])
def test_points_and_normals_are_those_of_the_definition(height, width, step):
    depth_m = (2.0 + 0.02 * RNG.standard_normal((height, width))).astype(np.float32)
    depth_m[5:9, 10:20] = 0.0
    depth_m[20, 30], depth_m[25, 31] = np.nan, 65.535
    depth_m[:, 40:] += 1.0
    T = se3_exp(RNG.normal(size=6))
    points, normals = np.empty((2, depth_m[::step, ::step].size, 3))
    n = write_points(depth_m, step, FX, FY, CX, CY, T, 2.99, points, normals)
    expected_points, expected_normals = _reference(depth_m, step, T, 2.99)
    assert n == len(expected_points) > 100
    np.testing.assert_allclose(points[:n], expected_points, atol=1e-12)
    np.testing.assert_allclose(normals[:n], expected_normals, atol=1e-12)


def test_normals_within_a_cone_are_added_up():
    normals = RNG.standard_normal((500, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    direction, total = normals[7], np.ones(3)
    near = normals @ direction > 0.5
    assert sum_within(normals, direction, 0.5, total) == near.sum() > 50
    np.testing.assert_allclose(total, normals[near].sum(axis=0), atol=1e-12)
