"""The keyframe that frames are aligned to directly: salient pixels, surface, and which one to take."""

from dataclasses import dataclass

import cv2
import numpy as np

from hsslam_node.depth_noise import EXACT_NOISE, depth_noise
from hsslam_node.frame import Frame
from hsslam_node.geometry.projection import project, world_points
from hsslam_node.geometry.se3 import inverse
from hsslam_node.kernels.tracking.depth_points import halve_depth, surface_of_depth
from hsslam_node.map.store import KeyframeStore, RetiredKeyframeError

PYRAMID_LEVELS = (0.125, 0.25, 0.5, 1.0)  # resolutions of the photometric term, coarse first
_SMALLEST_GRADIENT = 4.0  # grey levels per pixel


@dataclass(frozen=True)
class PyramidLevel:
    """An image at one resolution."""

    grey: np.ndarray  # [h, w] float32 0..255
    depth: np.ndarray  # [h, w] float32 m, 0 = unknown
    K: np.ndarray  # [4] float64 fx, fy, cx, cy


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


def grey_pyramid(frame: Frame) -> tuple[PyramidLevel, ...]:
    """Grey image and depth at the photometric resolutions, coarse first.

    The image is smoothed a little, so that bilinear interpolation between pixels is unbiased.
    """
    grey = cv2.GaussianBlur(
        cv2.cvtColor(frame.color, cv2.COLOR_RGB2GRAY).astype(np.float32), (3, 3), 0.7
    )
    depth = frame.depth_m()
    levels = []
    for factor in reversed(PYRAMID_LEVELS):
        camera = frame.camera.scaled(factor)
        K = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        if factor < 1.0:
            depth = _halved_depth(depth)
            height, width = depth.shape  # an odd row or column is left out
            even = grey[: 2 * height, : 2 * width]
            grey = cv2.resize(even, (width, height), interpolation=cv2.INTER_AREA)
        levels.append(PyramidLevel(grey, depth, K))
    return tuple(reversed(levels))


def _halved_depth(depth: np.ndarray) -> np.ndarray:
    """Mean of each 2x2 block; unknown where one of the four is, or where they lie apart."""
    height, width = depth.shape[0] // 2, depth.shape[1] // 2
    out = np.empty((height, width), np.float32)
    halve_depth(depth, out)
    return out


def reference_keyframe(
    id: int, frame: Frame, levels: tuple[PyramidLevel, ...], pixels: int
) -> ReferenceKeyframe:
    """Prepare a keyframe: about `pixels` salient pixels per level, and its surface with normals."""
    points, greys = [], []
    for level in levels:
        p, g = _salient_pixels(level, pixels)
        points.append(p)
        greys.append(g)
    noise = depth_noise(frame)
    surface_points, surface_normals, K = _surface(frame, noise)
    return ReferenceKeyframe(
        id, tuple(points), tuple(greys), surface_points, surface_normals, K, noise
    )


def stored_reference(store: KeyframeStore, k: int, pixels: int) -> ReferenceKeyframe:
    """The same of keyframe k of a store."""
    keyframe = store.frame(k)
    return reference_keyframe(k, keyframe, grey_pyramid(keyframe), pixels)


def _salient_pixels(level: PyramidLevel, wanted: int) -> tuple[np.ndarray, np.ndarray]:
    """The pixel of largest gradient in each cell of a grid, where depth is known and smooth."""
    height, width = level.grey.shape
    gx = cv2.Sobel(level.grey, cv2.CV_32F, 1, 0, scale=1 / 8)
    gy = cv2.Sobel(level.grey, cv2.CV_32F, 0, 1, scale=1 / 8)
    strength = gx * gx + gy * gy  # cv2.magnitude rounds by the address of its result
    low = cv2.erode(level.depth, np.ones((3, 3), np.uint8))
    high = cv2.dilate(level.depth, np.ones((3, 3), np.uint8))
    strength[(low <= 0) | (high - low > 0.05 * high)] = 0
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


def _surface(frame: Frame, noise: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points and normals where the depth is continuous: of all pixels as they are if it is exact, else
    at half resolution and smoothed, as inverse depth."""
    is_exact = noise < EXACT_NOISE
    camera = frame.camera if is_exact else frame.camera.scaled(0.5)
    K = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    depth = frame.depth_m() if is_exact else _halved_depth(frame.depth_m())
    low = cv2.erode(  # nor is the image continuous at its border
        depth, np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=(0.0,)
    )
    high = cv2.dilate(depth, np.ones((3, 3), np.uint8))
    continuous = (low > 0) & (high - low < 0.05 * high)
    if not is_exact:
        inverse_depth = np.divide(1.0, depth, out=np.zeros_like(depth), where=depth > 0)
        weight = _smoothed((depth > 0).astype(np.float32))
        depth = np.divide(weight, _smoothed(inverse_depth), out=depth, where=continuous)
    depth = np.where(continuous, depth, np.float32(0))
    points = np.empty((*depth.shape, 3), np.float32)
    normals = np.empty_like(points)
    surface_of_depth(depth, K, points, normals)
    return points, normals, K


def _smoothed(image: np.ndarray) -> np.ndarray:
    return cv2.GaussianBlur(image, (3, 3), 0.8)


_STRIDE_PX = 24
_CANDIDATES = 12  # that stand most like the camera
_TURN_M_PER_RAD = 1.0  # what a turn counts when they are chosen
_MARGIN_M, _MARGIN_SLOPE = 0.03, 0.02  # between two depths of one surface, with its distance
_CLEARLY = 0.1  # more of the frame's points than the current one


def covering_keyframe(
    store: KeyframeStore, frame: Frame, T_world_cam: np.ndarray, current: int
) -> int:
    """The keyframe on whose surface most of the frame's depth lies; `current` unless one is clearly better.

    Of equals it is that which stands most like the camera at T_world_cam [4, 4].
    """
    depth_m = frame.depth_raw / frame.depth_units_per_m
    points = world_points(depth_m, frame.camera, T_world_cam, _STRIDE_PX)
    if len(points) == 0:
        return current
    ids = store.kept()
    poses = store.poses_of(ids)
    relative = inverse(T_world_cam) @ poses  # [n, 4, 4]
    cosine = (np.trace(relative[:, :3, :3], axis1=1, axis2=2) - 1) / 2
    away = np.linalg.norm(relative[:, :3, 3], axis=1)
    away += _TURN_M_PER_RAD * np.arccos(np.clip(cosine, -1, 1))
    best, most = current, _shown(store, current, store.pose(current), points) + _CLEARLY
    for i in np.argsort(away, kind="stable")[:_CANDIDATES]:
        k = int(ids[i])
        share = _shown(store, k, poses[i], points)
        if k != current and share > most:
            best, most = k, share
    return best


def _shown(store: KeyframeStore, k: int, T_world_key: np.ndarray, points: np.ndarray) -> float:
    """Share of the points [N, 3] that lie on the surface that keyframe k shows."""
    camera = store.camera
    u, v, z = project(points, camera, inverse(T_world_key))
    u, v = np.round(u).astype(int), np.round(v).astype(int)
    inside = (z > 0.1) & (u >= 0) & (v >= 0) & (u < camera.width_px) & (v < camera.height_px)
    try:
        depth_raw = store.pixels(k)[1][v[inside], u[inside]]
    except RetiredKeyframeError:
        return 0.0
    gap = np.abs(depth_raw / store.depth_units_per_m - z[inside])
    return float(((depth_raw > 0) & (gap < _MARGIN_M + _MARGIN_SLOPE * z[inside])).sum()) / len(z)
