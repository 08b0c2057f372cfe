"""Which cells a depth image saw, and how well."""

import numpy as np

from hsslam_node.kernels.compiled import njit

_NEAREST_M = 0.1  # in front of a camera
_NOISE = 1.8e-3  # 1/m, of a Kinect: deviation of its depth z is this times z^2


@njit(cache=True, nogil=True, error_model="numpy")
def add_information(depth, intrinsics, T_cam_index, reach_m, far_m, information):
    """Add to each cell whose centre is at most `reach_m` behind the depth of its pixel."""
    height, width = depth.shape
    fx, fy, cx, cy = intrinsics
    inside = np.array(  # (x, y, z) is in view if a x + b y + c z + d >= 0 for each row
        [
            [fx, 0.0, cx + 0.5, 0.0],
            [-fx, 0.0, width - 0.5 - cx, 0.0],
            [0.0, fy, cy + 0.5, 0.0],
            [0.0, -fy, height - 0.5 - cy, 0.0],
            [0.0, 0.0, 1.0, -_NEAREST_M],
            [0.0, 0.0, -1.0, far_m],
        ]
    )
    nx, ny, nz = information.shape
    step = T_cam_index[:3, 0]
    for k in range(nz):
        for j in range(ny):
            start = T_cam_index[:3, 1] * j + T_cam_index[:3, 2] * k + T_cam_index[:3, 3]
            first, last = _in_view(inside, start, step, nx)
            for i in range(first, last + 1):
                z = start[2] + step[2] * i
                u = int(np.floor((start[0] + step[0] * i) / z * fx + cx + 0.5))
                v = int(np.floor((start[1] + step[1] * i) / z * fy + cy + 0.5))
                if u < 0 or v < 0 or u >= width or v >= height:  # rounding at the border
                    continue
                measured = depth[v, u]
                if measured > 0.0 and z <= measured + reach_m:
                    deviation = _NOISE * z * z
                    information[i, j, k] += np.float32(1.0 / (deviation * deviation))


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _in_view(inside, start, step, count):
    """First and last i below `count` for which start + i * step is in view; first > last: none.

    Both are clipped as floats: for a row along a plane they can be too large for an int.
    """
    first, last = 0.0, count - 1.0
    for p in range(inside.shape[0]):
        a, b, c, d = inside[p]
        here = a * start[0] + b * start[1] + c * start[2] + d
        slope = a * step[0] + b * step[1] + c * step[2]
        if slope > 0.0:
            first = max(first, -here / slope)
        elif slope < 0.0:
            last = min(last, -here / slope)
        elif here < 0.0:
            last = -1.0
    return int(np.ceil(min(first, count))), int(np.floor(max(last, -1.0)))
