"""OpenCV's RGB-D odometry between two frames; a file of its own as tracker and doctor share it."""

import cv2
import numpy as np

from hsslam_node.frame import Frame


def rgbd_odometry(first: Frame, second: Frame) -> np.ndarray | None:
    """T_first_second [4, 4] by `cv2.Odometry` at half resolution, or None if it fails."""
    camera = first.camera.scaled(0.5)
    settings = cv2.OdometrySettings()
    settings.setCameraMatrix(camera.K.astype(np.float32))
    odometry = cv2.Odometry(cv2.OdometryType_RGB_DEPTH, settings, cv2.OdometryAlgoType_FAST)
    try:
        ok, T_second_first = odometry.compute(*_half(first), *_half(second))[:2]
    except cv2.error:  # no pixel with depth
        return None
    if not ok or T_second_first is None or not np.isfinite(T_second_first).all():
        return None
    T = np.asarray(T_second_first, np.float64)
    return np.linalg.inv(T)


def _half(frame: Frame) -> tuple[np.ndarray, np.ndarray]:
    size = frame.camera.width_px // 2, frame.camera.height_px // 2
    grey = cv2.cvtColor(frame.color, cv2.COLOR_RGB2GRAY)
    depth = cv2.resize(frame.depth_m(), size, interpolation=cv2.INTER_NEAREST)
    return depth, cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
