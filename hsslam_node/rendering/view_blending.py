"""Colours of a surface from images of it, as seen from another place.

A surface that reflects has other colours in each view, and a map has one colour for all of them. Images taken
near the view have the right ones, and they are sharp.
Source: Buehler et al., Unstructured Lumigraph Rendering, SIGGRAPH 2001 (angle, resolution and border weights)
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import pixel_rays, project
from hsslam_node.geometry.se3 import inverse

_TOGETHER, _ROUNDS = 8, 3  # views of a round; a round fills what the views before do not show
_FILLED = 0.999  # of the pixels: no further round
_POINTS = 1000  # of the surface, to choose views by
_SAME_SURFACE_M, _SAME_SURFACE_RATIO = 0.04, 0.02  # of the depth
_SAME_RAY = 0.02  # rad: rays as close as this count alike
_WIDEST = 1.0  # rad between the rays of two views that show the same side of a thin thing
_FARTHER = 0.3  # rad that twice the distance is worth
_SHARPNESS = 3  # exponent of the weights: the larger, the more the best view counts
_BORDER_PX = 30.0  # of an image, where it fades out
_NEAREST_M = 0.05


@dataclass(frozen=True)
class PosedImages:
    """Images with depth, all of one camera without a lens, and their poses.

    `image(k)` is the colour [H, W, 3] uint8 RGB and the planar depth [H, W] float32 m, 0 = no measurement, of
    the k-th one.
    """

    camera: Camera
    T_world_cam: np.ndarray  # [n, 4, 4]
    image: Callable[[int], tuple[np.ndarray, np.ndarray]]


def blend_views(
    depth_m: np.ndarray, camera: Camera, T_world_cam: np.ndarray, images: PosedImages
) -> tuple[np.ndarray, np.ndarray]:
    """Colour [H, W, 3] float32 0..255 of a surface, and the mask [H, W] of the pixels that an image shows.

    Args:
        depth_m: [H, W] planar depth of the surface, m, 0 = none.
        camera: of the view, without a lens.
        T_world_cam: [4, 4] of the view.
        images: an image shows a point if its depth there agrees, so nothing hides the point.
    """
    points, rays = _surface(depth_m, camera, T_world_cam)
    distance_m = np.linalg.norm(points - T_world_cam[:3, 3].astype(np.float32), axis=-1)
    color = np.zeros((*depth_m.shape, 3), np.float32)
    total = np.zeros(depth_m.shape, np.float32)
    unused = np.arange(len(images.T_world_cam))
    for _ in range(_ROUNDS):
        left = (depth_m > 0) & (total == 0)
        if len(unused) == 0 or left.sum() <= (1 - _FILLED) * left.size:
            break
        nearest = unused[_nearest(points[left], rays[left], images, unused)]
        if len(nearest) == 0:
            break
        unused = np.setdiff1d(unused, nearest)
        for k in nearest:
            seen, weight = _seen(points, rays, distance_m, images, int(k))
            weight[~left] = 0.0
            color += weight[..., None] * seen
            total += weight
    shown = total > 0
    color[shown] /= total[shown, None]
    return color, shown


def _surface(depth_m: np.ndarray, camera: Camera, T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points [H, W, 3] m, world, and the unit rays [H, W, 3] to them, float32."""
    v, u = np.mgrid[: camera.height_px, : camera.width_px]
    along = (pixel_rays(u, v, camera) @ T[:3, :3].T).astype(np.float32)
    points = depth_m[..., None] * along + T[:3, 3].astype(np.float32)
    return points, along / np.linalg.norm(along, axis=-1, keepdims=True)


def _nearest(
    points: np.ndarray, rays: np.ndarray, images: PosedImages, among: np.ndarray
) -> np.ndarray:
    """Numbers, in `among`, of the views that see most of the points [N, 3] m at small angles to the rays."""
    step = max(1, len(points) // _POINTS)
    points, rays = points[::step].astype(np.float64), rays[::step]
    camera, scores = images.camera, np.empty(len(among))
    for row, k in enumerate(among):
        T = images.T_world_cam[k]
        u, v, z = project(points, camera, inverse(T))
        is_inside = (z > _NEAREST_M) & (np.minimum(u, v) >= 0)
        is_inside &= (u <= camera.width_px - 1) & (v <= camera.height_px - 1)
        angle, _ = _angles(points[is_inside], rays[is_inside], T)
        scores[row] = np.sum(1.0 / (angle[angle < _WIDEST] + _SAME_RAY))
    order = np.argsort(-scores, kind="stable")[:_TOGETHER]
    return order[scores[order] > 0]


def _seen(
    points: np.ndarray, rays: np.ndarray, distance_m: np.ndarray, images: PosedImages, k: int
) -> tuple[np.ndarray, np.ndarray]:
    """What image k shows of points [H, W, 3] m: colour [H, W, 3] uint8, and weight [H, W], 0 = hidden."""
    T, camera = images.T_world_cam[k], images.camera
    u, v, z = (
        values.reshape(distance_m.shape).astype(np.float32)
        for values in project(points.reshape(-1, 3), camera, inverse(T).astype(np.float32))
    )
    color, depth_m = images.image(k)
    measured_m = cv2.remap(depth_m, u, v, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT)
    border_px = np.minimum(
        np.minimum(u, camera.width_px - 1 - u), np.minimum(v, camera.height_px - 1 - v)
    )
    angle, from_m = _angles(points, rays, T)
    tolerance_m = _SAME_SURFACE_M + _SAME_SURFACE_RATIO * z
    is_seen = (distance_m > 0) & (z > _NEAREST_M) & (border_px > 0) & (angle < _WIDEST)
    is_seen &= (measured_m > 0) & (np.abs(measured_m - z) < tolerance_m)
    farther = np.maximum(from_m / np.maximum(distance_m, _NEAREST_M), 1.0) - 1.0
    badness = (angle + _FARTHER * farther) / _SAME_RAY + 1.0
    weight = np.where(
        is_seen, np.clip(border_px / _BORDER_PX, 0.01, 1.0) * badness**-_SHARPNESS, 0.0
    )
    seen = cv2.remap(color, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return seen, weight.astype(np.float32)


def _angles(points: np.ndarray, rays: np.ndarray, T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angles [...] rad (chords, below 60 degrees nearly the same) between unit rays [..., 3] and those from a
    camera at T [4, 4] to the points [..., 3] m, and the camera's distances [...] m."""
    from_camera = points - T[:3, 3].astype(points.dtype)
    distance_m = np.linalg.norm(from_camera, axis=-1)
    cosine = np.einsum("...i,...i", from_camera, rays) / np.maximum(distance_m, _NEAREST_M)
    return np.sqrt(np.maximum(2.0 - 2.0 * cosine, 0.0)), distance_m
