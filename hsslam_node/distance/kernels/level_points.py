"""Points of depth images with the normals of their surfaces, among which a floor is looked for."""

import numpy as np

from hsslam_node.kernels.compiled import njit

# share of its depth by which the four pixels beside a pixel differ less, on one surface
_SAME = 0.05


@njit(cache=True, nogil=True, error_model="numpy")
def write_points(depth_m, step, fx, fy, cx, cy, T_world_cam, max_depth_m, points, normals):
    """Write the points of a view, and the normals of the surface about them towards the camera; how many.

    Args:
        depth_m: [H, W] float32.
        step: px, between the pixels that are looked at, both ways.
        T_world_cam: [4, 4] float64.
        max_depth_m: pixels from here on have no point.
        points: [n, 3] float64 m, world; one row for each pixel that is looked at suffices.
        normals: [n, 3] float64, of unit length.
    """
    height, width = depth_m.shape
    T, count = T_world_cam, 0
    for row in range(step, height - step, step):
        above, here, below = depth_m[row - step], depth_m[row], depth_m[row + step]
        v_above, v, v_below = (row - step - cy) / fy, (row - cy) / fy, (row + step - cy) / fy
        for column in range(step, width - step, step):
            z, most = float(here[column]), _SAME * here[column]
            if not 0.0 < z < max_depth_m:
                continue
            left, right = float(here[column - step]), float(here[column + step])
            up, down = float(above[column]), float(below[column])
            if not (abs(left - z) < most and abs(right - z) < most):
                continue
            if not (abs(up - z) < most and abs(down - z) < most):
                continue
            u_left, u = (column - step - cx) / fx, (column - cx) / fx
            u_right = (column + step - cx) / fx
            a0, a1, a2 = u * down - u * up, v_below * down - v_above * up, down - up
            b0, b1, b2 = u_right * right - u_left * left, v * right - v * left, right - left
            # below x right: towards the camera, as y points down
            n0, n1, n2 = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
            length = np.sqrt(n0 * n0 + n1 * n1 + n2 * n2) + 1e-20
            n0, n1, n2 = n0 / length, n1 / length, n2 / length
            x, y = u * z, v * z
            for axis in range(3):
                points[count, axis] = T[axis, 0] * x + T[axis, 1] * y + T[axis, 2] * z + T[axis, 3]
                normals[count, axis] = T[axis, 0] * n0 + T[axis, 1] * n1 + T[axis, 2] * n2
            count += 1
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def sum_within(normals, direction, least_cosine, total):
    """Write the sum [3] of the normals [n, 3] that are nearer to a direction [3] than an angle; how many."""
    count = 0
    total[:] = 0.0
    for n in range(len(normals)):
        x, y, z = normals[n, 0], normals[n, 1], normals[n, 2]
        if x * direction[0] + y * direction[1] + z * direction[2] > least_cosine:
            total[0] += x
            total[1] += y
            total[2] += z
            count += 1
    return count
