"""A depth image as a surface: points with normals."""

import numpy as np
from numba import njit


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def surface_of_depth(depth, K, points, normals):
    """Fill points [h, w, 3] (m, camera) and unit normals [h, w, 3] from depth [h, w] (m, 0 = unknown).

    Normals come from central differences and point away from the camera's side they are seen from as
    the cross product of the image's v and u; 0 where one of the four neighbours is unknown. K [4].
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
