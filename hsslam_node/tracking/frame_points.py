"""Depth points of a frame, spread over the image."""

import numpy as np

from hsslam_node.config import TrackerConfig
from hsslam_node.frame import Frame
from hsslam_node.kernels.depth_points import sample_points


def frame_points(frame: Frame, config: TrackerConfig, seed: int) -> np.ndarray:
    """About `config.points` depth points [N, 3] float32 m, camera frame, none on a depth edge."""
    camera = frame.camera
    aspect = camera.width_px / camera.height_px
    # a fifth more cells than points: some fall on edges and holes
    rows = max(1, round(np.sqrt(1.2 * config.points / aspect)))
    columns = max(1, round(rows * aspect))
    jitter = np.random.default_rng((seed, frame.index)).random((rows * columns, 2))
    points = np.empty((rows * columns, 3), np.float32)
    K = np.array([camera.fx, camera.fy, camera.cx, camera.cy], np.float32)
    max_depth_m = np.float32(config.max_depth_m)
    n = sample_points(
        frame.depth_m(), K, jitter, columns, rows, config.border_px, max_depth_m, points
    )
    return points[:n]
