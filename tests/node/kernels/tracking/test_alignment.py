"""Normal equations against finite differences of their own cost."""

from collections.abc import Callable

import numpy as np
import pytest

from hsslam_node.geometry.se3 import inverse, se3_exp
from hsslam_node.kernels.tracking.alignment import (
    add_keyframe_surface_term,
    add_photometric_term,
    add_sdf_term,
)
from hsslam_node.kernels.tracking.depth_points import transform_points

TRUNCATION_M = 0.06
POSE = se3_exp(np.array([0.3, -0.2, 0.5, 0.2, -0.4, 0.1]))
HEIGHT, WIDTH = 60, 80
K = np.array([70.0, 72.0, 39.0, 30.5])
Cost = Callable[[np.ndarray, np.ndarray, np.ndarray], float]


def _moved(step: np.ndarray) -> np.ndarray:
    """POSE after a step [8] as the kernels define it: rotation in world axes about the centre."""
    T = POSE.copy()
    T[:3, :3] = se3_exp(np.array([0, 0, 0, *step[3:6]]))[:3, :3] @ T[:3, :3]
    T[:3, 3] += step[:3]
    return T


def _points(count: int = 80, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    z = rng.uniform(1.5, 2.5, count)
    xy = rng.uniform(-0.35, 0.35, (count, 2)) * z[:, None]
    return np.column_stack([xy, z]).astype(np.float32)


def _world(T: np.ndarray, points: np.ndarray) -> np.ndarray:
    world = np.empty_like(points)
    transform_points(T, points, world)
    return world


def _gradient(cost: Cost, step: float, columns: int) -> np.ndarray:
    slope = np.zeros(8)
    for a in range(columns):
        x = np.zeros(8)
        x[a] = step
        slope[a] = (cost(x, *_system()) - cost(-x, *_system())) / (2 * step)
    return slope


def _system() -> tuple[np.ndarray, np.ndarray]:
    return np.zeros((8, 8)), np.zeros(8)


def _check_gradient(cost: Cost, step: float, columns: int = 6) -> None:
    """b is half the gradient of the cost (Huber included), in each of its parts."""
    H, b = _system()
    cost(np.zeros(8), H, b)
    slope = 0.5 * _gradient(cost, step, columns)
    for part in (slice(0, 3), slice(3, 6), slice(6, columns)):
        assert np.linalg.norm(b[part] - slope[part]) <= 0.01 * np.linalg.norm(slope[part])
    assert (b[:columns] != 0).all()


def _check_rank_one(cost: Cost) -> None:
    """With one inlier H = w J J^T, b = w J r and the cost is w r^2."""
    H, b = _system()
    value = cost(np.zeros(8), H, b)
    assert value > 0
    np.testing.assert_allclose(H * value, np.triu(np.outer(b, b)), rtol=1e-4, atol=1e-9 * value**2)


def _sdf_cost(points: np.ndarray, huber_m: float) -> Cost:
    """Distance to a sphere of which the points are about 2 cm away."""
    centre = POSE[:3, 3] + POSE[:3, :3] @ np.array([0.1, 0.0, 0.2])
    radius = np.linalg.norm(_world(POSE, points) - centre, axis=1)
    radius += np.random.default_rng(1).uniform(-0.03, 0.03, len(points))

    def cost(x, H, b):
        T = _moved(x)
        world = _world(T, points)
        offset = world - centre
        distance = np.linalg.norm(offset, axis=1)
        sdf = ((distance - radius) / TRUNCATION_M).astype(np.float32)
        gradient = (offset / distance[:, None] / TRUNCATION_M).astype(np.float32)
        inside = np.ones(len(points), np.uint8)
        return add_sdf_term(
            sdf, gradient, inside, world, points[:, 2], T[:3, 3].copy(), TRUNCATION_M,
            0.005, 0.0019, huber_m, H, b,
        )[0]  # fmt: skip

    return cost


@pytest.mark.parametrize("huber_m", [0.01, 1.0], ids=["huber", "quadratic"])
def test_sdf_term(huber_m):
    _check_gradient(_sdf_cost(_points(), huber_m), 1e-3)
    _check_rank_one(_sdf_cost(_points(1), 1.0))


def test_sdf_term_counts():
    points = _points(5)
    sdf = np.array([0.1, -0.2, 0.5, 0.97, 0.0], np.float32)
    inside = np.array([1, 1, 1, 1, 0], np.uint8)
    gradient = np.full((5, 3), 1 / TRUNCATION_M, np.float32)
    H, b = _system()
    _, inliers, seen, squares = add_sdf_term(
        sdf, gradient, inside, _world(POSE, points), points[:, 2], POSE[:3, 3].copy(),
        TRUNCATION_M, 0.005, 0.0019, 0.02, H, b,
    )  # fmt: skip
    assert (inliers, seen) == (2, 4)  # 3 cm is beyond Huber, 0.97 T is no evidence, one is outside
    assert squares == pytest.approx(0.006**2 + 0.012**2, rel=1e-5)


def test_sdf_term_trusts_far_points_less():
    near, far = np.array([[0, 0, 1.0]], np.float32), np.array([[0, 0, 4.0]], np.float32)
    weights = []
    for points in (near, far):
        H, b = _system()
        gradient = np.array([[1 / TRUNCATION_M, 0, 0]], np.float32)
        add_sdf_term(
            np.array([0.1], np.float32), gradient, np.ones(1, np.uint8), points, points[:, 2],
            np.zeros(3), TRUNCATION_M, 0.005, 0.0019, 0.02, H, b,
        )  # fmt: skip
        weights.append(H[0, 0])
    sigmas = [0.005 + 0.0019 * 0.6**2, 0.005 + 0.0019 * 3.6**2]
    np.testing.assert_allclose(weights, [s**-2 for s in sigmas], rtol=1e-5)


def _surface_cost(points: np.ndarray, reach: float) -> Cost:
    """A tilted plane seen by a keyframe beside the camera."""
    normal = np.array([0.3, -0.2, -1.0]) / np.linalg.norm([0.3, -0.2, -1.0])
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    rays = np.stack([(u - K[2]) / K[0], (v - K[3]) / K[1], np.ones_like(u)], -1)
    surface = rays * (normal @ np.array([0, 0, 2.0]) / (rays @ normal))[..., None]
    T_key_world = inverse(POSE @ se3_exp(np.array([0.02, 0.01, -0.02, 0.01, 0.02, 0.0])))
    on_plane = points.astype(np.float64)
    key = on_plane @ (T_key_world @ POSE)[:3, :3].T + (T_key_world @ POSE)[:3, 3]
    away = np.random.default_rng(2).uniform(-0.03, 0.03, len(points))
    key -= ((key @ normal - normal[2] * 2.0 - away)[:, None]) * normal
    T_cam_key = inverse(T_key_world @ POSE)
    placed = (key @ T_cam_key[:3, :3].T + T_cam_key[:3, 3]).astype(np.float32)
    normals = np.broadcast_to(normal, surface.shape).astype(np.float32)

    def cost(x, H, b):
        T = _moved(x)
        value, _, met = add_keyframe_surface_term(
            placed, _world(T, placed), T[:3, 3].copy(), T_key_world, surface.astype(np.float32),
            np.ascontiguousarray(normals), K, 0.005, 0.0, 1.0, reach, 0.02, 0.05, H, b,
        )  # fmt: skip
        assert met == len(points)
        return value

    return cost


@pytest.mark.parametrize("reach", [3.0, 1e3], ids=["robust", "quadratic"])
def test_keyframe_surface_term(reach):
    _check_gradient(_surface_cost(_points(), reach), 1e-4)
    _check_rank_one(_surface_cost(_points(1), 1e3))


def test_keyframe_surface_term_has_no_ear_for_what_moves():
    """A sixth of the points 4 cm off pull no more than 2 % of what they would pull as inliers."""
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    rays = np.stack([(u - K[2]) / K[0], (v - K[3]) / K[1], np.ones_like(u)], -1)
    normals = np.broadcast_to(np.array([0, 0, -1], np.float32), rays.shape).copy()
    points = _points(60)
    points[:, :2] *= 2.0 / points[:, 2:]
    points[:, 2] = 2.0
    points[:10, 2] -= 0.04
    pulls = []
    for reach in (3.0, 1e3):
        H, b = _system()
        _, inliers, met = add_keyframe_surface_term(
            points, points, np.zeros(3), np.eye(4), (2.0 * rays).astype(np.float32), normals, K,
            0.001, 0.001, 1.0, reach, 0.02, 0.05, H, b,
        )  # fmt: skip
        assert (inliers, met) == (50, 60)
        pulls.append(abs(b[2]))
    assert 0 < pulls[0] < 0.02 * pulls[1]


def _photometric_cost(points: np.ndarray, huber: float) -> Cost:
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    grey = (120 + 60 * np.sin(u / 5.0 + v / 9.0) + 40 * np.cos(v / 4.0)).astype(np.float32)
    depth = np.zeros((HEIGHT, WIDTH), np.float32)
    world = points.astype(np.float64) @ POSE[:3, :3].T + POSE[:3, 3]
    key_grey = np.random.default_rng(3).uniform(90, 150, len(points)).astype(np.float32)

    def cost(x, H, b):
        value, _, seen = add_photometric_term(
            grey,
            depth,
            0.05,
            K,
            world,
            key_grey,
            _moved(x),
            float(x[6]),
            1.1 + float(x[7]),
            8.0,
            huber,
            H,
            b,
        )
        assert seen == len(points)
        return value

    return cost


@pytest.mark.parametrize("huber", [10.0, 1e3], ids=["huber", "quadratic"])
def test_photometric_term(huber):
    _check_gradient(_photometric_cost(_points(), huber), 1e-6, columns=8)
    _check_rank_one(_photometric_cost(_points(1), 1e3))


def test_photometric_term_passes_over_what_is_hidden_or_out_of_view():
    grey = np.full((HEIGHT, WIDTH), 100, np.float32)
    depth = np.full((HEIGHT, WIDTH), 1.0, np.float32)
    depth[:, WIDTH // 2 :] = 2.0
    x = np.array([-0.3, 0.3, 0.3, 5.0, 0.0])
    key = np.column_stack([x, np.zeros(5), [2.0, 2.0, 1.5, 2.0, -2.0]])
    H, b = _system()
    key_grey = np.full(5, 100, np.float32)
    _, inliers, seen = add_photometric_term(
        grey, depth, 0.05, K, key, key_grey, np.eye(4), 0.0, 1.0, 8.0, 10.0, H, b
    )
    assert (inliers, seen) == (1, 1)
