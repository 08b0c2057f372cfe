"""The reference keyframe, prepared for alignment: its salient pixels and its surface."""

from dataclasses import dataclass

import cv2
import numpy as np

from hsslam_node.config import TrackerConfig
from hsslam_node.depth_noise import EXACT_NOISE, averaging_limit, depth_noise
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.kernels.tracking.depth_points import halve_depth, surface_of_depth
from hsslam_node.map.store import KeyframeStore
from hsslam_node.tracking.keyframes.other_views import OtherViews, views_near

PYRAMID_LEVELS = (0.125, 0.25, 0.5, 1.0)  # resolutions of the photometric term, coarse first
_SMALLEST_GRADIENT = 4.0  # grey levels per pixel
# Neighbouring pixels of one surface differ by less than this share of their depth. If the focal length is
# shorter, the share is larger, as a pixel spans more of a slope.
_DEPTH_STEP, _DEPTH_STEP_FOCAL_PX = 0.05, 120.0


@dataclass(frozen=True)
class PyramidLevel:
    """An image at one resolution."""

    grey: np.ndarray  # [h, w] float32 0..255
    depth: np.ndarray  # [h, w] float32 m, 0 = unknown
    K: np.ndarray  # [4] float64 fx, fy, cx, cy
    depth_step: float  # share of the depth; neighbours that differ by more lie on two surfaces


@dataclass(frozen=True)
class ReferenceKeyframe:
    """A keyframe prepared for alignment; everything in its own camera frame."""

    id: int
    points: tuple[np.ndarray, ...]  # per level [N, 3] float64 m, salient pixels
    grey: tuple[np.ndarray, ...]  # per level [N] float32 0..255
    surface_points: np.ndarray  # [h, w, 3] float32 m, at full or half resolution
    surface_normals: np.ndarray  # [h, w, 3] float32, 0 = none
    surface_K: np.ndarray  # [4] float64
    depth_noise: float  # 1/m, of the inverse depth
    averaging_limit: float  # 1/m, see `depth_noise.py`; 0: depth is not averaged over pixels


def grey_pyramid(frame: Frame) -> tuple[PyramidLevel, ...]:
    """Grey image and depth at the photometric resolutions, coarse first.

    The image is smoothed a little, so that bilinear interpolation between pixels is unbiased.
    """
    grey = cv2.GaussianBlur(
        cv2.cvtColor(frame.color, cv2.COLOR_RGB2GRAY).astype(np.float32), (3, 3), 0.7
    )
    depth = frame.depth_m()
    depth_step = _depth_step(frame.camera)
    levels = []
    for factor in reversed(PYRAMID_LEVELS):
        camera = frame.camera.scaled(factor)
        K = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        if factor < 1.0:
            depth = _halved_depth(depth, depth_step)
            height, width = depth.shape  # an odd row or column is left out
            even = grey[: 2 * height, : 2 * width]
            grey = cv2.resize(even, (width, height), interpolation=cv2.INTER_AREA)
        levels.append(PyramidLevel(grey, depth, K, depth_step))
    return tuple(reversed(levels))


def _depth_step(camera: Camera) -> float:
    """Share of the depth by which neighbouring pixels of one surface may differ, at all levels."""
    return _DEPTH_STEP * max(1.0, _DEPTH_STEP_FOCAL_PX / min(camera.fx, camera.fy))


def _halved_depth(depth: np.ndarray, depth_step: float) -> np.ndarray:
    """Mean of each 2x2 block; unknown if one of the four is, or if they lie on two surfaces."""
    height, width = depth.shape[0] // 2, depth.shape[1] // 2
    out = np.empty((height, width), np.float32)
    halve_depth(depth, np.float32(depth_step), out)
    return out


def reference_keyframe(
    id: int,
    frame: Frame,
    levels: tuple[PyramidLevel, ...],
    config: TrackerConfig,
    views: OtherViews | None = None,
) -> ReferenceKeyframe:
    """Prepare a keyframe: its surface with normals, and about `photometric_pixels` salient pixels per level.

    `views`: keyframes near it; noisy depth is averaged over those that see the same surface.
    """
    points, greys = [], []
    for level in levels:
        p, g = _salient_pixels(level, config.photometric_pixels)
        if views:
            averaged = (frame.camera.width_px // level.grey.shape[1]) ** 2
            p *= (views.averaged(p[:, :2] / p[:, 2:], p[:, 2], averaged) / p[:, 2])[:, None]
        points.append(p)
        greys.append(g)
    noise = depth_noise(frame)
    surface_points, surface_normals, K = _surface(frame, noise, views)
    window_px = config.depth_window_px
    limit = views.averaging_limit if views else averaging_limit(frame, window_px)
    return ReferenceKeyframe(
        id, tuple(points), tuple(greys), surface_points, surface_normals, K, noise, limit
    )


def stored_reference(store: KeyframeStore, k: int, config: TrackerConfig) -> ReferenceKeyframe:
    """Prepare keyframe k of a store."""
    keyframe = store.frame(k)
    views = views_near(store, k, keyframe, config)
    levels = grey_pyramid(keyframe)
    return reference_keyframe(k, keyframe, levels, config, views)


def _salient_pixels(level: PyramidLevel, wanted: int) -> tuple[np.ndarray, np.ndarray]:
    """The pixel of largest gradient in each cell of a grid, where depth is known and smooth."""
    height, width = level.grey.shape
    gx = cv2.Sobel(level.grey, cv2.CV_32F, 1, 0, scale=1 / 8)
    gy = cv2.Sobel(level.grey, cv2.CV_32F, 0, 1, scale=1 / 8)
    strength = gx * gx + gy * gy  # cv2.magnitude rounds by the address of its result
    low = cv2.erode(level.depth, np.ones((3, 3), np.uint8))
    high = cv2.dilate(level.depth, np.ones((3, 3), np.uint8))
    strength[(low <= 0) | (high - low > level.depth_step * high)] = 0
    strength[:2], strength[-2:], strength[:, :2], strength[:, -2:] = 0, 0, 0, 0
    cell = max(1, int(np.sqrt(height * width / max(wanted, 1))))
    rows, columns = height // cell, width // cell
    blocks = (
        strength[: rows * cell, : columns * cell]
        .reshape(rows, cell, columns, cell)
        .transpose(0, 2, 1, 3)
        .reshape(rows * columns, cell * cell)
    )
    best = blocks.argmax(axis=1)
    keep = blocks[np.arange(len(best)), best] > _SMALLEST_GRADIENT**2
    index = np.flatnonzero(keep)
    v = (index // columns) * cell + best[index] // cell
    u = (index % columns) * cell + best[index] % cell
    z = level.depth[v, u].astype(np.float64)
    fx, fy, cx, cy = level.K
    points = np.stack([(u - cx) / fx * z, (v - cy) / fy * z, z], axis=-1)
    return points, level.grey[v, u]


def _surface(
    frame: Frame, noise: float, views: OtherViews | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points and normals where the depth is continuous: at full resolution if it is exact, else at half
    resolution, averaged over the views and smoothed, as inverse depth."""
    is_exact = noise < EXACT_NOISE
    depth_step = _depth_step(frame.camera)
    camera = frame.camera if is_exact else frame.camera.scaled(0.5)
    K = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    depth = frame.depth_m() if is_exact else _halved_depth(frame.depth_m(), depth_step)
    low = cv2.erode(  # the image is not continuous at its border
        depth, np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=(0.0,)
    )
    high = cv2.dilate(depth, np.ones((3, 3), np.uint8))
    continuous = (low > 0) & (high - low < depth_step * high)
    if views:
        depth = _averaged(depth, K, views)
    if not is_exact:
        inverse_depth = np.divide(1.0, depth, out=np.zeros_like(depth), where=depth > 0)
        weight = _smoothed((depth > 0).astype(np.float32))
        depth = np.divide(weight, _smoothed(inverse_depth), out=depth, where=continuous)
    depth = np.where(continuous, depth, np.float32(0))
    points = np.empty((*depth.shape, 3), np.float32)
    normals = np.empty_like(points)
    surface_of_depth(depth, K, points, normals)
    return points, normals, K


def _averaged(depth: np.ndarray, K: np.ndarray, views: OtherViews) -> np.ndarray:
    """Depth [h, w] at half resolution, averaged over the views."""
    v, u = np.indices(depth.shape)
    rays = np.stack([(u - K[2]) / K[0], (v - K[3]) / K[1]], -1).reshape(-1, 2)
    return views.averaged(rays, depth.ravel(), 4).reshape(depth.shape).astype(np.float32)


def _smoothed(image: np.ndarray) -> np.ndarray:
    return cv2.GaussianBlur(image, (3, 3), 0.8)
