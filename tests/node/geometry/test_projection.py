import numpy as np

from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import camera_points, project, world_points
from hsslam_node.geometry.se3 import inverse

CAMERA = Camera(6, 4, 5.0, 4.0, 2.5, 1.5)
T_WORLD_CAM = np.array([[0.0, -1, 0, 3], [1, 0, 0, 2], [0, 0, 1, 1], [0, 0, 0, 1]])


def test_points_lie_on_the_rays_of_their_pixels():
    depth_m = np.zeros((4, 6), np.float32)
    depth_m[1, 5], depth_m[3, 0] = 2.0, 4.0
    expected = [[1.0, -0.25, 2.0], [-2.0, 1.5, 4.0]]
    np.testing.assert_allclose(camera_points(depth_m, CAMERA), expected, atol=1e-12)


def test_a_stride_leaves_pixels_out():
    depth_m = np.arange(1, 25, dtype=np.float32).reshape(4, 6)
    every = camera_points(depth_m, CAMERA).reshape(4, 6, 3)
    np.testing.assert_array_equal(
        camera_points(depth_m, CAMERA, stride_px=3), every[::3, ::3].reshape(-1, 3)
    )


def test_points_of_the_world_are_seen_at_their_pixels_and_depth():
    depth_m = np.arange(24, dtype=np.float32).reshape(4, 6)  # none at the first pixel
    points = world_points(depth_m, CAMERA, T_WORLD_CAM)
    u, v, z = project(points, CAMERA, inverse(T_WORLD_CAM))
    rows, columns = np.nonzero(depth_m)
    np.testing.assert_allclose([v, u, z], [rows, columns, depth_m[rows, columns]], atol=1e-9)


def test_what_is_behind_the_camera_has_a_negative_depth_and_finite_pixels():
    u, v, z = project(np.array([[0.5, 0.5, -1.0], [0.5, 0.5, 0.0]]), CAMERA, np.eye(4))
    assert (z <= 0).all() and np.isfinite([u, v]).all()
