"""Averages the depth of a keyframe's pixels with that of another view. It runs on the CPU only."""

import numpy as np

from hsslam_node.kernels.compiled import njit

_NEAREST_M = 0.1
_LEAST_SLOPE = 0.3  # of the depth in the other view, by the depth in the keyframe


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def add_view(rays, T_view_key, depth_raw, metres_per_unit, K, gate, total, count):
    """Add the inverse depths that a view measured to the sums of a keyframe's pixels.

    rays [N, 2]: x and y of a pixel's ray at z = 1, keyframe camera; total [N] 1/m and count [N]: sum and
    number of inverse depths so far, 0 = depth unknown. depth_raw [H, W] and K [4] are of the view. Each
    pixel's point, at its mean depth so far, projects between four pixels of the view. Those whose inverse
    depth differs from the point's by less than `gate`, 1/m, show the same surface and count.
    """
    height, width = depth_raw.shape
    R = T_view_key
    for n in range(rays.shape[0]):
        if count[n] <= 0.0:
            continue
        own = total[n] / count[n]
        rx, ry = rays[n, 0], rays[n, 1]
        slope = R[2, 0] * rx + R[2, 1] * ry + R[2, 2]
        z = slope / own + R[2, 3]
        if z < _NEAREST_M or slope < _LEAST_SLOPE:
            continue
        x = (R[0, 0] * rx + R[0, 1] * ry + R[0, 2]) / own + R[0, 3]
        y = (R[1, 0] * rx + R[1, 1] * ry + R[1, 2]) / own + R[1, 3]
        u = int(np.floor(K[0] * x / z + K[2]))
        v = int(np.floor(K[1] * y / z + K[3]))
        if u < 0 or v < 0 or u + 1 >= width or v + 1 >= height:
            continue
        difference = 0.0
        met = 0
        for j in range(v, v + 2):
            for i in range(u, u + 2):
                raw = depth_raw[j, i]
                if raw == 0:
                    continue
                off = 1.0 / (raw * metres_per_unit) - 1.0 / z
                if abs(off) < gate:
                    difference += off
                    met += 1
        # along the ray, to first order: d(1/z) = slope (own z)^-2 d(own)
        total[n] += met * own + difference * (own * z) * (own * z) / slope
        count[n] += met
