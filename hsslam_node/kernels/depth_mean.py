"""Mean depth around a pixel; apart because kernels of mapping and of tracking use it."""

import numpy as np

from hsslam_node.kernels.compiled import njit


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def mean_depth(depth, u, v, metres_per_unit, radius_px, same_surface):
    """Depth, m, from the mean inverse depth of the pixel and of pairs of pixels opposite each other.

    On a plane of any slope the mean of a pair is the pixel's own inverse depth. depth [H, W] in sensor units
    is known at (u, v). Pairs lie within `radius_px`; their mean differs by less than `same_surface`, 1/m.
    """
    height, width = depth.shape
    own = np.float32(1.0) / np.float32(depth[v, u])  # 1 / sensor units, as all below
    limit = np.float32(2.0 * same_surface * metres_per_unit)
    total = own
    count = 1
    for dy in range(min(radius_px, v, height - 1 - v) + 1):
        reach = min(radius_px, u, width - 1 - u)
        for dx in range(-reach if dy > 0 else 1, reach + 1):
            one = np.float32(depth[v + dy, u + dx])
            other = np.float32(depth[v - dy, u - dx])
            product = one * other
            if product > 0.0:
                pair = (one + other) / product
                if abs(pair - np.float32(2.0) * own) < limit:
                    total += pair
                    count += 2
    return np.float32(count) / total * np.float32(metres_per_unit)
