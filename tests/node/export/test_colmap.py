"""COLMAP's text: one camera, two points, of which it sees one."""

import numpy as np

from hsslam_node.export.colmap import cameras_text, images_text, observe, points_text
from hsslam_node.geometry.camera import Camera

_CAMERA = Camera(8, 6, 4.0, 4.0, 3.5, 2.5)
_POINTS = np.array([[0.0, 0.0, 2.0], [0.5, 0.0, 2.0]])  # m


def _wall(depth_m: float) -> np.ndarray:
    return np.full((6, 8), depth_m, np.float32)


def test_a_point_is_observed_where_the_depth_confirms_it():
    hidden = _wall(2.0)
    hidden[:, 4:] = 1.0
    left = _POINTS - [0.5, 0, 0]
    seen = observe(left, _CAMERA, np.eye(4), hidden, most=10)
    assert seen.points.tolist() == [0]
    np.testing.assert_allclose(seen.uv, [[2.5, 2.5]])
    assert observe(left, _CAMERA, np.eye(4), _wall(2.0), most=10).points.tolist() == [0, 1]
    assert observe(left, _CAMERA, np.eye(4), _wall(2.0), most=1).points.tolist() == [0]
    assert observe(left, _CAMERA, np.eye(4), _wall(0.0), most=10).points.tolist() == []
    behind = np.diag([-1.0, 1.0, -1.0, 1.0])
    assert observe(left, _CAMERA, behind, _wall(2.0), most=10).points.tolist() == []


def test_text_counts_from_one_and_pixels_from_their_corner():
    T_world_cam = np.eye(4)
    T_world_cam[0, 3] = 0.5
    seen = observe(_POINTS, _CAMERA, T_world_cam, _wall(2.0), most=10)
    assert cameras_text(_CAMERA).splitlines()[1] == "1 PINHOLE 8 6 4.0 4.0 4.0 3.0"
    pose, observations = images_text(T_world_cam[None], ["a.jpg"], [seen]).splitlines()[2:]
    assert [float(word) for word in pose.split()[:8]] == [1, 1, 0, 0, 0, -0.5, 0, 0]
    assert pose.endswith(" 1 a.jpg")
    assert observations == "3.000 3.000 1 4.000 3.000 2"
    colors = np.array([[1, 2, 3], [4, 5, 6]], np.uint8)
    points = points_text(_POINTS, colors, [seen]).splitlines()[1:]
    assert points == [
        "1 0.000000 0.000000 2.000000 1 2 3 0 1 0",
        "2 0.500000 0.000000 2.000000 4 5 6 0 1 1",
    ]


def test_who_sees_nothing_has_an_empty_line():
    seen = observe(_POINTS, _CAMERA, np.eye(4), _wall(0.0), most=10)
    assert images_text(np.eye(4)[None], ["a.jpg"], [seen]).endswith(" a.jpg\n\n")
