"""Pixels with depth to points, and points to pixels, of a pinhole camera without distortion."""

import numpy as np

from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import transformed


def pixel_rays(u: np.ndarray, v: np.ndarray, camera: Camera) -> np.ndarray:
    """Rays [..., 3] float64 through pixels at columns u and rows v [...] px, in the camera's axes.

    Each is one metre of planar depth long.
    """
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    return np.stack([x, y, np.ones(x.shape)], axis=-1)


def camera_points(depth_m: np.ndarray, camera: Camera, stride_px: int = 1) -> np.ndarray:
    """Points [N, 3] float64 m, in the camera's axes, of the pixels with depth, row by row.

    Args:
        depth_m: [H, W], planar, 0 = no measurement.
        stride_px: step between the pixels of a row and of a column.
    """
    z = depth_m[::stride_px, ::stride_px]
    v, u = np.nonzero(z)
    z = z[v, u].astype(np.float64)
    x = (stride_px * u - camera.cx) / camera.fx * z
    y = (stride_px * v - camera.cy) / camera.fy * z
    return np.stack([x, y, z], axis=-1)


def world_points(
    depth_m: np.ndarray, camera: Camera, T_world_cam: np.ndarray, stride_px: int = 1
) -> np.ndarray:
    """`camera_points` [N, 3] float64 m in the world; T_world_cam [4, 4]."""
    points = camera_points(depth_m, camera, stride_px)
    return transformed(T_world_cam, points)


def project(
    points: np.ndarray, camera: Camera, T_cam_points: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where a camera sees points [N, 3]: u and v [N] px, and planar depth [N] m.

    T_cam_points [4, 4] maps the points to the camera's axes. If the depth is less than a millimetre, as
    behind the camera, u and v mean nothing.
    """
    x, y, z = transformed(T_cam_points, points).T
    ahead = np.maximum(z, 1e-3)
    return camera.fx * x / ahead + camera.cx, camera.fy * y / ahead + camera.cy, z
