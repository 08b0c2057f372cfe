"""Averages the depth of a keyframe's pixels with that of other views. It runs on the CPU only."""

import numpy as np

from hsslam_node.kernels.compiled import njit

_NEAREST_M = 0.1
_LEAST_SLOPE = 0.3  # of the depth in the other view, by the depth in the keyframe


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def add_view(rays, T_view_key, depth_raw, metres_per_unit, K, gate, total, count):
    """Add the inverse depths that a view measured to the sums of a keyframe's pixels.

    rays [N, >= 2]: x and y of a pixel's ray at z = 1, keyframe camera; total [N] 1/m and count [N]: sum and
    number of inverse depths so far, 0 = depth unknown. depth_raw [H, W] and K [4] are of the view. Each
    pixel's point, at its mean depth so far, projects between four pixels of the view. Those whose inverse
    depth differs from the point's by less than `gate`, 1/m, show the same surface and count.

    Images lie far apart in memory. The pixels of all points are read one after the other, without a
    decision between them, so that the processor waits for many at a time.
    """
    N = rays.shape[0]
    first, z, slope = np.empty(N, np.int64), np.empty(N), np.empty(N)
    _project(rays, T_view_key, K, depth_raw.shape, total, count, first, z, slope)
    pixels, width = depth_raw.reshape(-1), depth_raw.shape[1]
    raw = np.empty((N, 4), np.uint16)
    for n in range(N):
        at = max(first[n], 0)
        raw[n, 0] = pixels[at]
        raw[n, 1] = pixels[at + 1]
        raw[n, 2] = pixels[at + width]
        raw[n, 3] = pixels[at + width + 1]
    for n in range(N):
        if first[n] < 0:
            continue
        difference, met = 0.0, 0
        for k in range(4):
            if raw[n, k] > 0:
                off = 1.0 / (raw[n, k] * metres_per_unit) - 1.0 / z[n]
                if abs(off) < gate:
                    difference += off
                    met += 1
        own = total[n] / count[n]
        # along the ray, to first order: d(1/z) = slope (own z)^-2 d(own)
        total[n] += met * own + difference * (own * z[n]) * (own * z[n]) / slope[n]
        count[n] += met


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _project(rays, T_view_key, K, shape, total, count, first, z, slope):
    """Write the flat index `first` [N] of the upper left of four pixels of the view, -1 if there are none,
    the point's depth z [N] m in the view, and its derivative `slope` [N]."""
    height, width = shape
    T = T_view_key
    for n in range(rays.shape[0]):
        first[n] = -1
        if count[n] <= 0.0:
            continue
        own = total[n] / count[n]
        x, y = rays[n, 0], rays[n, 1]
        slope[n] = T[2, 0] * x + T[2, 1] * y + T[2, 2]
        z[n] = slope[n] / own + T[2, 3]
        if z[n] < _NEAREST_M or slope[n] < _LEAST_SLOPE:
            continue
        x, y = (
            (T[0, 0] * x + T[0, 1] * y + T[0, 2]) / own + T[0, 3],
            (T[1, 0] * x + T[1, 1] * y + T[1, 2]) / own + T[1, 3],
        )
        u = int(np.floor(K[0] * x / z[n] + K[2]))
        v = int(np.floor(K[1] * y / z[n] + K[3]))
        if u >= 0 and v >= 0 and u + 1 < width and v + 1 < height:
            first[n] = v * width + u


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def average_depth(
    direction, depth, pixels, T_view_key, depth_raw, views, metres_per_unit, K, gate
):  # fmt: skip
    """Replace the depth of rays by the mean over their keyframe and the first `views` other views.

    direction [N, 3] with z = 1, keyframe camera; depth [N] m, each the mean of `pixels` pixels, <= 0 =
    unknown. T_view_key [V, 4, 4]; depth_raw: a tuple of V images. Others as in `add_view`.
    """
    N = depth.shape[0]
    total, count = np.zeros(N), np.zeros(N)
    for n in range(N):
        if depth[n] > 0.0:
            count[n] = pixels
            total[n] = pixels / depth[n]
    for k in range(views):
        add_view(direction, T_view_key[k], depth_raw[k], metres_per_unit, K, gate, total, count)
    for n in range(N):
        if count[n] > 0.0:
            depth[n] = count[n] / total[n]
