"""A mask of moving objects: pixels in space that earlier keyframes saw as free lose their depth."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse, transformed
from hsslam_node.map.store import KeyframeStore

_CELLS = 80  # across the image
_MARGIN_M, _MARGIN_SLOPE = 0.1, 0.02  # two depths within first + second z, m, are one surface
_FEWEST_CELLS = 12  # of an object
_LARGEST_SHARE = 0.6  # of the image; a larger mask means a wrong pose
_STEP = 0.05  # share of the depth by which neighbouring cells of one object differ at most
_SPACES, _EVERY = 8, 2  # keyframes that are compared; every second one
_FIRST, _LAST, _ALL = slice(None, -1), slice(1, None), slice(None)
_SIDES = (
    ((_LAST, _ALL), (_FIRST, _ALL)),
    ((_FIRST, _ALL), (_LAST, _ALL)),
    ((_ALL, _LAST), (_ALL, _FIRST)),
    ((_ALL, _FIRST), (_ALL, _LAST)),
)  # cells of an image that have a neighbour on one side, and these neighbours


class DynamicMask:
    """Removes depth from a keyframe where earlier keyframes saw free space."""

    def __init__(self, store: KeyframeStore) -> None:
        self._store = store
        self._seen: deque[SeenSpace] = deque(maxlen=_SPACES)

    def observe(self, keyframe: int, frame: Frame) -> None:
        """Remember the depth of a keyframe of the store."""
        if not self._seen or keyframe - self._seen[-1].keyframe >= _EVERY:
            self._seen.append(seen_space(keyframe, frame))

    def left_out(self, frame: Frame, T_world_cam: np.ndarray) -> Frame:
        """The frame at T_world_cam [4, 4], without depth on objects that have moved."""
        seen = [(space, self._store.pose(space.keyframe)) for space in self._seen]
        return without_dynamic_pixels(frame, T_world_cam, seen)


@dataclass(frozen=True)
class SeenSpace:
    """Depth of a keyframe, one value a cell."""

    keyframe: int
    depth: np.ndarray  # [h, w] float32 m, 0 = unknown
    free: np.ndarray  # [h, w] float32 m, least depth of the cell and its neighbours
    step_px: int


def seen_space(keyframe: int, frame: Frame) -> SeenSpace:
    """The keyframe's depth in cells."""
    step = max(1, frame.camera.width_px // _CELLS)
    depth = np.ascontiguousarray(frame.depth_m()[step // 2 :: step, step // 2 :: step])
    free = cv2.erode(depth, np.ones((3, 3), np.uint8))
    return SeenSpace(keyframe, depth, free, step)


def without_dynamic_pixels(
    frame: Frame, T_world_cam: np.ndarray, seen: Sequence[tuple[SeenSpace, np.ndarray]]
) -> Frame:
    """The frame without depth on objects in space that `seen` (with poses [4, 4]) shows as free.

    The frame itself if there is no such object, or if the mask is too large.
    """
    now = seen_space(-1, frame)
    is_free = np.zeros(now.depth.shape, bool)
    is_surface = np.zeros(now.depth.shape, bool)
    for space, T_world_key in seen:
        free, surface = _compared(now, frame, inverse(T_world_key) @ T_world_cam, space)
        is_free |= free
        is_surface |= surface
    mask = _objects(is_free & ~is_surface, ~is_surface & (now.depth > 0), now.depth)
    if not mask.any() or mask.mean() > _LARGEST_SHARE:
        return frame
    wide = cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8))
    height, width = frame.depth_raw.shape
    full = cv2.resize(wide, None, fx=now.step_px, fy=now.step_px, interpolation=cv2.INTER_NEAREST)[
        :height, :width
    ]
    depth_raw = frame.depth_raw.copy()
    depth_raw[: full.shape[0], : full.shape[1]][full > 0] = 0
    return replace(frame, depth_raw=depth_raw)


def _compared(
    now: SeenSpace, frame: Frame, T_key_cam: np.ndarray, space: SeenSpace
) -> tuple[np.ndarray, np.ndarray]:
    """Cells [h, w] in the keyframe's free space, and cells on its surface."""
    camera, step, z = frame.camera, now.step_px, now.depth
    v, u = np.mgrid[: z.shape[0], : z.shape[1]] * step + step // 2
    points = np.stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z], -1)
    x, y, depth = np.moveaxis(transformed(T_key_cam, points), -1, 0)
    ahead = np.maximum(depth, 0.1)
    column = np.floor((camera.fx * x / ahead + camera.cx) / step).astype(int)
    row = np.floor((camera.fy * y / ahead + camera.cy) / step).astype(int)
    height, width = z.shape
    inside = (z > 0) & (depth > 0.1)
    inside &= (row >= 0) & (column >= 0) & (row < height) & (column < width)
    row, column = np.where(inside, row, 0), np.where(inside, column, 0)
    margin = _MARGIN_M + _MARGIN_SLOPE * ahead
    free = inside & (space.free[row, column] > depth + margin)
    known = space.depth[row, column]
    return free, inside & (known > 0) & (np.abs(known - depth) < margin)


def _objects(seeds: np.ndarray, unknown: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Mask [h, w] of connected seeds, grown over unknown cells of continuous depth."""
    count, label, stats, _ = cv2.connectedComponentsWithStats(seeds.astype(np.uint8))
    large = np.flatnonzero(stats[1:, cv2.CC_STAT_AREA] >= _FEWEST_CELLS) + 1
    mask = np.isin(label, large) if count > 1 else np.zeros(seeds.shape, bool)
    if not mask.any():
        return mask
    while True:
        grown = mask.copy()
        for cells, neighbours in _SIDES:
            is_near = np.abs(depth[neighbours] - depth[cells]) < _STEP * depth[cells]
            grown[cells] |= mask[neighbours] & unknown[cells] & is_near
        if (grown == mask).all():
            return mask
        mask = grown
