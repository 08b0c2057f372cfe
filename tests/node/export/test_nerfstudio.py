"""What nerfstudio reads: intrinsics, poses and depth of a camera whose pixels are known."""

import json

import numpy as np

from hsslam_node.export.nerfstudio import depth_mm, transforms_json
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import project
from hsslam_node.geometry.se3 import inverse, se3_exp

_CAMERA = Camera(64, 48, 50.0, 51.0, 31.5, 23.0)


def test_points_project_to_the_same_pixels():
    """By OpenGL's rule: the camera looks along -z, y is up, and the image counts from its corner."""
    rng = np.random.default_rng(0)
    T_world_cam = np.stack([se3_exp(0.3 * rng.normal(size=6)) for _ in range(3)])
    told = json.loads(transforms_json(_CAMERA, T_world_cam, ["a", "b", "c"], "points.ply"))
    assert told["ply_file_path"] == "points.ply"
    points = rng.uniform((-1, -1, 2), (1, 1, 4), (20, 3))
    for frame, T, name in zip(told["frames"], T_world_cam, "abc", strict=True):
        assert frame["file_path"] == f"images/{name}.jpg"
        assert frame["depth_file_path"] == f"depth/{name}.png"
        assert (frame["w"], frame["h"]) == (64, 48)
        T_opengl_world = inverse(np.array(frame["transform_matrix"]))
        x, y, z = T_opengl_world[:3, :3] @ points.T + T_opengl_world[:3, 3:]
        u = frame["cx"] + frame["fl_x"] * x / -z
        v = frame["cy"] - frame["fl_y"] * y / -z
        expected_u, expected_v, _ = project(points, _CAMERA, inverse(T))
        np.testing.assert_allclose(u, expected_u + 0.5)
        np.testing.assert_allclose(v, expected_v + 0.5)


def test_depth_is_in_millimetres_and_nothing_where_there_is_none():
    depth = depth_mm(np.array([[0.0, 1.2344, 65.535, 65.6, 400.0]], np.float32))
    assert depth.dtype == np.uint16
    assert depth.tolist() == [[0, 1234, 65535, 0, 0]]
