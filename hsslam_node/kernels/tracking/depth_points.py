"""Depth images as points and as surfaces with normals. It runs on the CPU only: there is no twin."""

import numpy as np

from hsslam_node.kernels.compiled import njit
from hsslam_node.kernels.depth_mean import mean_depth


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def sample_points(
    depth, K, jitter, columns, rows, border, max_depth_m, radius_px, same_surface, points
):  # fmt: skip
    """Back-project one random pixel of each grid cell, unless it lies on a depth edge or has no depth.

    depth [H, W] float32 m; K [4] = fx, fy, cx, cy; jitter [rows * columns, 2] in 0..1. The depth of a point
    is the `mean_depth` around its pixel, or the pixel's own if `same_surface` is 0. Fills points [N, 3] (m,
    camera) and returns their number.
    """
    height, width = depth.shape
    cell_w = (width - 2 * border) / columns
    cell_h = (height - 2 * border) / rows
    n = 0
    for j in range(rows):
        for i in range(columns):
            u = int(border + (i + jitter[j * columns + i, 0]) * cell_w)
            v = int(border + (j + jitter[j * columns + i, 1]) * cell_h)
            if u < 2 or v < 2 or u >= width - 2 or v >= height - 2:
                continue
            d = depth[v, u]
            if d <= 0.0 or d > max_depth_m:
                continue
            left, right, up, down = (
                depth[v, u - 2],
                depth[v, u + 2],
                depth[v - 2, u],
                depth[v + 2, u],
            )
            if left <= 0 or right <= 0 or up <= 0 or down <= 0:
                continue
            # on a plane the second difference vanishes; across an edge it does not
            limit = np.float32(0.01) * d * max(d, np.float32(1.0))
            if abs(left + right - 2 * d) > limit or abs(up + down - 2 * d) > limit:
                continue
            if same_surface > 0.0:
                d = mean_depth(depth, u, v, 1.0, radius_px, same_surface)
            points[n, 0] = (np.float32(u) - K[2]) / K[0] * d
            points[n, 1] = (np.float32(v) - K[3]) / K[1] * d
            points[n, 2] = d
            n += 1
    return n


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def halve_depth(depth, depth_step, out):
    """out [h, w] = harmonic mean of each 2x2 block of depth [2h, 2w]; 0 if one is 0 or if they lie apart.

    depth_step float32: largest difference of depth on one surface, as a share of the depth.

    Inverse depth is linear in the image of a plane, so the mean is the depth at the block's centre.
    """
    for v in range(out.shape[0]):
        for u in range(out.shape[1]):
            a = depth[2 * v, 2 * u]
            b = depth[2 * v, 2 * u + 1]
            c = depth[2 * v + 1, 2 * u]
            d = depth[2 * v + 1, 2 * u + 1]
            low = min(min(a, b), min(c, d))
            high = max(max(a, b), max(c, d))
            if low > 0 and high - low < depth_step * high:
                out[v, u] = np.float32(4.0) / (
                    np.float32(1.0) / a
                    + np.float32(1.0) / b
                    + np.float32(1.0) / c
                    + np.float32(1.0) / d
                )
            else:
                out[v, u] = np.float32(0.0)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def transform_points(T, points, out):
    """out = T [4, 4] applied to points [N, 3]."""
    for k in range(points.shape[0]):
        for a in range(3):
            out[k, a] = (
                T[a, 0] * points[k, 0] + T[a, 1] * points[k, 1] + T[a, 2] * points[k, 2] + T[a, 3]
            )


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def surface_of_depth(depth, K, points, normals):
    """Fill points [h, w, 3] (m, camera) and unit normals [h, w, 3] from depth [h, w] (m, 0 = unknown).

    Normals come from central differences and point towards the camera; 0 if the pixel or one of its four
    neighbours is unknown. K [4].
    """
    height, width = depth.shape
    for v in range(height):
        for u in range(width):
            z = depth[v, u]
            points[v, u, 0] = (np.float32(u) - np.float32(K[2])) / np.float32(K[0]) * z
            points[v, u, 1] = (np.float32(v) - np.float32(K[3])) / np.float32(K[1]) * z
            points[v, u, 2] = z
            for a in range(3):
                normals[v, u, a] = 0
    for v in range(1, height - 1):
        for u in range(1, width - 1):
            if (
                depth[v, u] <= 0
                or depth[v, u - 1] <= 0
                or depth[v, u + 1] <= 0
                or depth[v - 1, u] <= 0
                or depth[v + 1, u] <= 0
            ):
                continue
            x0 = points[v, u + 1, 0] - points[v, u - 1, 0]
            y0 = points[v, u + 1, 1] - points[v, u - 1, 1]
            z0 = points[v, u + 1, 2] - points[v, u - 1, 2]
            x1 = points[v + 1, u, 0] - points[v - 1, u, 0]
            y1 = points[v + 1, u, 1] - points[v - 1, u, 1]
            z1 = points[v + 1, u, 2] - points[v - 1, u, 2]
            nx, ny, nz = y1 * z0 - z1 * y0, z1 * x0 - x1 * z0, x1 * y0 - y1 * x0
            length = np.sqrt(nx * nx + ny * ny + nz * nz)
            if length > 0:
                normals[v, u, 0] = nx / length
                normals[v, u, 1] = ny / length
                normals[v, u, 2] = nz / length
