import numpy as np
import pytest

from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.camera import Camera
from hsslam_node.rendering.sdf_ray_caster import SdfRayCaster

_CAMERA = Camera(32, 24, 30.0, 30.0, 15.5, 11.5)
_TRUNCATION_M = 0.1
_BOUND = Bound((-2.0, -2.0, -2.0), (2.0, 2.0, 2.0))


def _sphere(points: np.ndarray) -> np.ndarray:
    """A ball of radius 0.5 m about (0, 0, 1), in truncations."""
    distance_m = np.linalg.norm(points - np.array([0, 0, 1.0]), axis=1) - 0.5
    return np.clip(distance_m / _TRUNCATION_M, -1, 1).astype(np.float32)


def _true_depth(z_camera: float) -> np.ndarray:
    v, u = np.mgrid[: _CAMERA.height_px, : _CAMERA.width_px]
    x, y = (u - _CAMERA.cx) / _CAMERA.fx, (v - _CAMERA.cy) / _CAMERA.fy
    a, b, c = x**2 + y**2 + 1, -(1 - z_camera), (1 - z_camera) ** 2 - 0.25
    root = b**2 - a * c
    return np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, 0.0)


@pytest.mark.parametrize("z_camera", [0.0, -1.0, -5.0])  # the last one is outside the bound
def test_depth_of_a_ball(z_camera):
    T = np.eye(4)
    T[2, 3] = z_camera
    depth = SdfRayCaster(_sphere, _BOUND, _TRUNCATION_M).depth(_CAMERA, T)
    true = _true_depth(z_camera)
    both = (depth > 0) & (true > 0)
    assert both.sum() >= 0.97 * (true > 0).sum() > 0
    assert ((depth > 0) & (true == 0)).sum() <= 2
    np.testing.assert_allclose(depth[both], true[both], atol=2e-3)


def test_nothing_is_seen_beyond_the_bound_or_from_inside_a_surface():
    small = Bound((-2.0, -2.0, -2.0), (2.0, 2.0, 0.4))
    caster = SdfRayCaster(_sphere, small, _TRUNCATION_M)
    assert not caster.depth(_CAMERA, np.eye(4)).any()
    inside = np.eye(4)
    inside[2, 3] = 1.0
    assert not SdfRayCaster(_sphere, _BOUND, _TRUNCATION_M).depth(_CAMERA, inside).any()


def test_a_camera_so_far_away_that_a_step_is_lost_in_rounding_sees_nothing():
    straight = Camera(31, 23, 30.0, 30.0, 15.0, 11.0)
    far = np.eye(4)
    far[2, 3] = -1e15
    assert not SdfRayCaster(_sphere, _BOUND, _TRUNCATION_M).depth(straight, far).any()


def test_a_ray_goes_on_behind_a_surface_that_does_not_count():
    def balls(points: np.ndarray) -> np.ndarray:
        """A smaller one before the ball, about (0, 0, -0.5)."""
        distance_m = np.linalg.norm(points - np.array([0, 0, -0.5]), axis=1) - 0.3
        return np.minimum(_sphere(points), distance_m / _TRUNCATION_M).astype(np.float32)

    caster = SdfRayCaster(balls, _BOUND, _TRUNCATION_M)
    origins, along = np.array([[0, 0, -1.5], [0, 0.4, -1.5]]), np.array([[0, 0, 1.0]] * 2)

    def cast(most_m: float, least_z: float) -> np.ndarray:
        return caster.distances(origins, along, most_m, lambda places: places[:, 2] > least_z)

    np.testing.assert_allclose(cast(9.0, -9.0), [0.7, 2.2], atol=5e-3)
    np.testing.assert_allclose(cast(9.0, 0.0), [2.0, 2.2], atol=5e-3)
    assert cast(9.0, 0.0)[1] == cast(9.0, -9.0)[1]
    assert not cast(1.9, 0.0).any() and not cast(9.0, 9.0).any()
    T = np.eye(4)
    T[2, 3] = -1.0
    behind = caster.depth(_CAMERA, T, lambda places: places[:, 2] > 0.0)
    alone = SdfRayCaster(_sphere, _BOUND, _TRUNCATION_M).depth(_CAMERA, T)
    assert np.abs(caster.depth(_CAMERA, T) - alone).max() > 0.5
    np.testing.assert_allclose(behind, alone, atol=2e-3)
