"""Points of a depth image: as many as are wanted at most, where the pixels see them."""

import numpy as np
import pytest

from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_services.ros2.depth_points import depth_points


@pytest.mark.parametrize("size", [(640, 480), (641, 479), (32, 24), (1920, 1080)])
def test_they_are_never_more_than_wanted(size):
    width_px, height_px = size
    camera = Camera(width_px, height_px, fx=500.0, fy=510.0, cx=width_px / 2, cy=height_px / 3)
    depth = np.full((height_px, width_px), 2000, np.uint16)
    depth[:, : width_px // 4] = 0
    depth[: height_px // 4] = 65535  # as some cameras write that they measured nothing
    color = np.zeros((height_px, width_px, 3), np.uint8)
    color[..., 0] = np.arange(height_px)[:, None] % 256
    points, colors = depth_points(
        Frame(0, 0, camera, color, depth, 1000.0), 20_000, max_depth_m=12.0
    )
    assert 0.3 * min(20_000, width_px * height_px) < len(points) <= 20_000
    assert (points[:, 2] == 2.0).all()
    u = 500.0 * points[:, 0] / points[:, 2] + camera.cx
    v = 510.0 * points[:, 1] / points[:, 2] + camera.cy
    assert u.min() > width_px // 4 - 0.01 and u.max() < width_px
    np.testing.assert_array_equal(np.round(v).astype(int) % 256, colors[:, 0])
