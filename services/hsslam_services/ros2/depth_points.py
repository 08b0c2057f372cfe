"""A depth image as a bounded number of points; alone, as it needs no ROS."""

import math

import numpy as np

from hsslam_node.frame import Frame


def depth_points(frame: Frame, most: int, max_depth_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Points [n, 3] float32 m in the camera frame with their colours [n, 3] uint8, n <= `most`.

    Samples every k-th column and row, k as small as possible; skips pixels without depth or deeper than
    `max_depth_m`.
    """
    camera = frame.camera
    step = math.ceil(math.sqrt(camera.width_px * camera.height_px / most))
    while -(-camera.width_px // step) * -(-camera.height_px // step) > most:
        step += 1
    z = frame.depth_raw[::step, ::step].astype(np.float32) / np.float32(frame.depth_units_per_m)
    v, u = np.nonzero((z > 0) & (z <= max_depth_m))
    z = z[v, u]
    x = (step * u - camera.cx) / camera.fx * z
    y = (step * v - camera.cy) / camera.fy * z
    points = np.stack([x, y, z], axis=1).astype(np.float32)
    return points, frame.color[::step, ::step][v, u]
