"""Points that a depth image shows."""

import numpy as np

from hsslam_node.frame import Frame


def back_projected(frame: Frame) -> np.ndarray:
    """Points [H W, 3] in the camera's frame, m."""
    c, z = frame.camera, frame.depth_m().astype(np.float64)
    v, u = np.indices(z.shape)
    return np.stack([(u - c.cx) / c.fx * z, (v - c.cy) / c.fy * z, z], -1).reshape(-1, 3)
