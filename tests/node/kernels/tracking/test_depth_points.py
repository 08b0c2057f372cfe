"""Depth points of a frame, and depth at half resolution."""

import numpy as np

from hsslam_node.kernels.tracking.depth_points import halve_depth, sample_points

HEIGHT, WIDTH = 60, 80
K = np.array([70.0, 72.0, 39.0, 30.5])
STEP = np.float32(0.05)


def _sampled(
    depth: np.ndarray,
    border: int = 6,
    max_depth_m: float = 6.0,
    radius_px: int = 0,
    same_surface: float = 0.0,
) -> np.ndarray:
    rows, columns = 12, 16
    jitter = np.random.default_rng(0).random((rows * columns, 2))
    points = np.empty((rows * columns, 3), np.float32)
    n = sample_points(
        depth, K.astype(np.float32), jitter, columns, rows, border, np.float32(max_depth_m), radius_px,
        same_surface, points,
    )  # fmt: skip
    return points[:n]


def _pixels(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    u = points[:, 0] / points[:, 2] * K[0] + K[2]
    v = points[:, 1] / points[:, 2] * K[1] + K[3]
    np.testing.assert_allclose([u, v], np.rint([u, v]), atol=1e-3)
    return np.rint(u).astype(int), np.rint(v).astype(int)


def test_depth_points_are_back_projected_pixels_within_the_border():
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    depth = (1.0 / (0.5 + 0.001 * u - 0.002 * v)).astype(np.float32)  # a slanted plane
    points = _sampled(depth)
    assert len(points) == 12 * 16
    u, v = _pixels(points)
    np.testing.assert_allclose(points[:, 2], depth[v, u])
    assert u.min() >= 6 and v.min() >= 6 and u.max() < WIDTH - 6 and v.max() < HEIGHT - 6


def test_the_mean_about_a_pixel_takes_noise_away_and_keeps_a_slanted_plane():
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    plane = 0.5 + 0.001 * u - 0.002 * v  # inverse depth
    noise = np.random.default_rng(1).normal(0, 1e-3, plane.shape)
    noisy = (1 / (plane + noise)).astype(np.float32)
    errors = []
    for radius_px in (0, 2):
        points = _sampled(noisy, radius_px=radius_px, same_surface=2e-3)
        u, v = _pixels(points)
        errors.append(1 / points[:, 2] - plane[v, u])
    alone, averaged = errors
    assert np.std(alone) > 0.9e-3
    assert np.std(averaged) < 0.4e-3
    assert abs(averaged.mean()) < 0.1e-3


def test_no_border_still_reads_inside_the_image():
    assert 100 < len(_sampled(np.full((HEIGHT, WIDTH), 2.0, np.float32), border=0)) <= 12 * 16


def test_depth_points_avoid_edges_holes_and_the_far():
    depth = np.full((HEIGHT, WIDTH), 2.0, np.float32)
    depth[:, 20:] = 1.5  # an edge
    depth[30:36, 40:50] = 0.0  # a hole
    depth[:, 60:] = 7.0  # too far
    u, v = _pixels(_sampled(depth))
    assert len(u) > 60 and u.max() < 58
    assert not ((u >= 18) & (u < 22)).any()
    assert not ((u >= 38) & (u < 52) & (v >= 30) & (v < 36)).any()
    assert not ((u >= 40) & (u < 50) & (v >= 28) & (v < 38)).any()
    assert _sampled(np.zeros((HEIGHT, WIDTH), np.float32)).size == 0


def test_halved_depth_of_a_plane_is_the_plane():
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
    inverse_depth = 0.4 + 0.003 * u - 0.002 * v
    half = np.empty((HEIGHT // 2, WIDTH // 2), np.float32)
    halve_depth((1 / inverse_depth).astype(np.float32), STEP, half)
    centres = inverse_depth[::2, ::2] + 0.5 * (0.003 - 0.002)
    np.testing.assert_allclose(half, 1 / centres, rtol=1e-6)


def test_halved_depth_does_not_mix_surfaces():
    depth = np.full((4, 6), 2.0, np.float32)
    depth[0, 1] = 0.0
    depth[2:, 3:] = 1.0
    half = np.empty((2, 3), np.float32)
    halve_depth(depth, STEP, half)
    np.testing.assert_array_equal(half, [[0, 2, 2], [2, 0, 1]])
