"""A depth image as kernels ask it for whole footprints: without flying pixels, with extremes of regions."""

from typing import NamedTuple

import numpy as np

from hsslam_node.geometry.camera import Camera
from hsslam_node.kernels.compiled import njit

TILE_PX = 8
REACHES_PX = (2, 4, 8)  # of the nearest pixel about each
_SAME = 0.04  # neighbouring pixels whose depth differs by a smaller share lie on one surface
_FEWEST_SAME = 3  # of eight neighbours; a pixel with fewer flies between two surfaces
_FREE = 0.8  # of the least depth about a flying pixel


class DepthExtremes(NamedTuple):
    """What kernels take; a hole is a pixel that measured nothing, a tile has 8 x 8 pixels.

    In the extremes a flying pixel has the least depth that it or a neighbour measured, less a fifth: the edge
    that it saw may be nearer.
    """

    depth: np.ndarray  # [h, w] float32 m, planar; 0: a hole or a flying pixel
    nearest: np.ndarray  # [3, h, w] float32 m, least within REACHES_PX; 0: there is a hole
    tile_nearest: np.ndarray  # [ceil(h / 8), ceil(w / 8)] float32 m; 0: it has a hole
    tile_farthest: np.ndarray  # same; 0: it has nothing else
    fx: float  # of the pixels above, as are the others
    fy: float
    cx: float
    cy: float


def depth_extremes(
    depth_m: np.ndarray, camera: Camera, stride_px: int, max_depth_m: float
) -> DepthExtremes:
    """Of every stride-th pixel of depth [H, W] m, taken by a camera without a lens.

    A pixel beyond `max_depth_m` is a hole: some cameras write 65535 where they measured nothing.
    """
    chosen = depth_m[::stride_px, ::stride_px]
    h, w = chosen.shape
    padded = np.empty((h + 2, w + 2), np.float32)
    _fill_padded(chosen, np.float32(max_depth_m), padded)
    depth, bounded = np.empty((2, h, w), np.float32)
    _without_flying(padded, depth)
    _bound_flying(padded, depth, bounded)
    nearest = np.empty((len(REACHES_PX), h, w), np.float32)
    _fill_nearest(bounded, nearest)
    tiles = (-(-h // TILE_PX), -(-w // TILE_PX))
    low, high = np.empty(tiles, np.float32), np.empty(tiles, np.float32)
    _fill_tiles(bounded, low, high)
    values = (value / stride_px for value in (camera.fx, camera.fy, camera.cx, camera.cy))
    return DepthExtremes(depth, nearest, low, high, *values)


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_padded(depth, most, padded):
    """Write depth [h, w] up to `most`, m, else 0, into the middle of `padded` [h + 2, w + 2]; 0 about it."""
    h, w = depth.shape
    padded[0], padded[h + 1] = 0.0, 0.0
    for row in range(h):
        source, target = depth[row], padded[row + 1]
        target[0], target[w + 1] = 0.0, 0.0
        inner = target[1 : w + 1]
        for column in range(w):
            z = source[column]
            inner[column] = z if z <= most else np.float32(0.0)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _without_flying(padded, depth):
    """Write the pixels of `padded` [h + 2, w + 2] that lie on a surface with some of their neighbours."""
    h, w = depth.shape
    for row in range(h):
        above, here, below = padded[row], padded[row + 1], padded[row + 2]
        for column in range(w):
            z = here[column + 1]
            limit = np.float32(_SAME) * z
            same = np.int32(abs(above[column] - z) < limit)
            same += np.int32(abs(above[column + 1] - z) < limit)
            same += np.int32(abs(above[column + 2] - z) < limit)
            same += np.int32(abs(here[column] - z) < limit)
            same += np.int32(abs(here[column + 2] - z) < limit)
            same += np.int32(abs(below[column] - z) < limit)
            same += np.int32(abs(below[column + 1] - z) < limit)
            same += np.int32(abs(below[column + 2] - z) < limit)
            depth[row, column] = z if same >= _FEWEST_SAME else np.float32(0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _bound_flying(padded, depth, bounded):
    """Write `depth` [h, w], and for flying pixels how far the way is free for certain."""
    h, w = depth.shape
    for row in range(h):
        here, kept, out = padded[row + 1], depth[row], bounded[row]
        for column in range(w):
            least = kept[column]
            if least == 0.0 and 0.0 < here[column + 1] < np.inf:
                least = here[column + 1]
                for beside in range(row, row + 3):
                    for z in padded[beside, column : column + 3]:
                        if z > 0.0:
                            least = min(least, z)
                least *= np.float32(_FREE)
            out[column] = least


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _fill_nearest(depth, nearest):
    """The least of windows of 5, 9 and 17 pixels, both ways; windows end with the image."""
    h, w = depth.shape
    line = np.empty((h, w), np.float32)
    for level in range(3):
        source, target = depth if level == 0 else nearest[level - 1], nearest[level]
        if level == 0:  # 3 pixels, then 5
            _least_of_pairs(source, line, target, 1, True)
            _least_of_pairs(target, line, target, 1, True)
        else:  # two windows of the level before, which meet in the middle
            _least_of_pairs(source, line, target, REACHES_PX[level] // 2, False)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _least_of_pairs(source, line, target, reach, with_middle):
    """Write the least of the two pixels `reach` to the sides, and of the pixel itself if asked, both ways."""
    h, w = source.shape
    for row in range(h):
        a, out = source[row], line[row]
        left, right, inner = a[: w - 2 * reach], a[2 * reach :], out[reach : w - reach]
        for c in range(len(inner)):
            inner[c] = min(left[c], right[c])
        for c in range(reach):
            out[c] = min(a[0], a[c + reach])
            out[w - 1 - c] = min(a[w - 1], a[w - 1 - c - reach])
        if with_middle:
            for c in range(w):
                out[c] = min(out[c], a[c])
    for row in range(h):
        a, b, out = line[max(row - reach, 0)], line[min(row + reach, h - 1)], target[row]
        for c in range(w):
            out[c] = min(a[c], b[c])
        if with_middle:
            a = line[row]
            for c in range(w):
                out[c] = min(out[c], a[c])


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _fill_tiles(depth, low, high):
    h, w = depth.shape
    for r in range(low.shape[0]):
        for c in range(low.shape[1]):
            least, most = np.float32(1e9), np.float32(0.0)
            for row in range(TILE_PX * r, min(TILE_PX * r + TILE_PX, h)):
                for column in range(TILE_PX * c, min(TILE_PX * c + TILE_PX, w)):
                    z = depth[row, column]
                    least, most = min(least, z), max(most, z)
            low[r, c], high[r, c] = least, most
