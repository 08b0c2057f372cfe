"""Undistortion of colour and depth."""

import cv2
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.undistortion import Undistortion

LENS = (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)
CAMERA = Camera(640, 480, 517.3, 516.5, 318.6, 255.3, LENS)


def test_without_distortion_nothing_is_touched():
    undistortion = Undistortion(CAMERA.undistorted())
    depth = np.zeros((480, 640), np.uint16)
    assert undistortion.depth(depth) is depth


@given(st.integers(120, 520), st.integers(90, 390))
def test_a_point_lands_where_a_pinhole_would_have_put_it(u, v):
    """A dot drawn where the lens puts a ray comes out at the ray's pinhole pixel, to a pixel."""
    ray = np.array([[(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, 1.0]])
    seen, _ = cv2.projectPoints(ray, np.zeros(3), np.zeros(3), CAMERA.K, np.array(LENS))
    x, y = np.rint(seen.ravel()).astype(int)
    depth, color = np.zeros((480, 640), np.uint16), np.zeros((480, 640, 3), np.uint8)
    depth[y - 1 : y + 2, x - 1 : x + 2] = 7000
    color[y - 1 : y + 2, x - 1 : x + 2] = 255
    undistortion = UNDISTORTION
    assert undistortion.depth(depth)[v, u] == 7000
    assert undistortion.color(color)[v, u, 0] > 100


def test_depth_is_never_interpolated():
    depth = np.where(np.indices((480, 640)).sum(axis=0) % 7 < 3, 5000, 20000).astype(np.uint16)
    assert set(np.unique(UNDISTORTION.depth(depth))) <= {0, 5000, 20000}


UNDISTORTION = Undistortion(CAMERA)
