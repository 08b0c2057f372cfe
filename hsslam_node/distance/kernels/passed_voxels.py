"""The voxels of a part of 4 x 4 x 4 that a depth image saw through, one by one."""

import numpy as np

from hsslam_node.distance.kernels.depth_extremes import REACHES_PX
from hsslam_node.distance.kernels.hits import LEAST
from hsslam_node.kernels.compiled import njit

PART = 4  # voxels along a side
NEAREST_M = 0.1
_SIDE_SAMPLES = 2  # pixels looked at to each side of an occupied voxel's middle
_THROUGH = 0.8  # share of them that clears it


@njit(cache=True, nogil=True, error_model="numpy")
def steps_in_part(image, A):
    """Along x, y (pixels times m) and z (m) of the camera, from a part's first voxel to each, [3, 64]."""
    steps = np.empty((3, PART**3))
    scale = (image.fx, image.fy, 1.0)
    for n in range(PART**3):
        a, b, c = n % PART, n // PART % PART, n // PART**2
        for axis in range(3):
            steps[axis, n] = scale[axis] * (A[axis, 0] * a + A[axis, 1] * b + A[axis, 2] * c)
    return steps


@njit(cache=True, nogil=True, error_model="numpy")
def place_voxels(image, A, i, j, k, steps, places):
    """Write column and row in the image, and depth, m, of the middles of a part's voxels, [3, 64]."""
    u_0 = (A[0, 0] * i + A[0, 1] * j + A[0, 2] * k + A[0, 3]) * image.fx
    v_0 = (A[1, 0] * i + A[1, 1] * j + A[1, 2] * k + A[1, 3]) * image.fy
    z_0 = A[2, 0] * i + A[2, 1] * j + A[2, 2] * k + A[2, 3]
    u_steps, v_steps, z_steps = steps[0], steps[1], steps[2]
    right, down, ahead = places[0], places[1], places[2]
    u_middle, v_middle = image.cx + 0.5, image.cy + 0.5
    for n in range(PART**3):
        z = z_0 + z_steps[n]
        per_z = 1.0 / z
        ahead[n] = z
        right[n] = (u_0 + u_steps[n]) * per_z + u_middle
        down[n] = (v_0 + v_steps[n]) * per_z + v_middle


@njit(cache=True, nogil=True, error_model="numpy")
def pass_voxels(image, places, i, j, k, voxel_m, far_m, farthest, slot, evidence, asked):
    """The voxels of a part one by one; none of its pixels saw farther than `farthest`, m.

    `asked` [64] int64: room for the numbers of the voxels that are looked for in the image. They are chosen
    without branches, as no processor could foresee them.
    """
    half_px = 0.5 * voxel_m * max(image.fx, image.fy)  # of a voxel 1 m away
    right, down, ahead = places[0], places[1], places[2]
    for n in asked[: _ask(image, places, i, j, k, voxel_m, far_m, farthest, slot, evidence, asked)]:
        a, b, c = i + n % PART, j + n // PART % PART, k + n // PART**2
        u, v, z = int(right[n]), int(down[n]), ahead[n]
        through, before = z + 0.5 * voxel_m, evidence[c, b, a]
        level = (half_px > REACHES_PX[0] * z) + (half_px > REACHES_PX[1] * z)
        is_through = image.nearest[level, v, u] > through
        if before > 0 and not is_through:
            is_through = _most_see_through(image, u, v, half_px / z, through)
        evidence[c, b, a] = before - is_through


@njit(cache=True, nogil=True, error_model="numpy")
def _ask(image, places, i, j, k, voxel_m, far_m, farthest, slot, evidence, asked):
    """Write the numbers of a part's voxels that a pass may change and that are in the image; how many."""
    nz, ny, nx = evidence.shape
    height, width = image.depth.shape
    right, down, ahead = places[0], places[1], places[2]
    count = 0
    for c in range(k, min(k + PART, nz)):
        for b in range(j, min(j + PART, ny)):
            here, hits = evidence[c, b], slot[c, b]
            first = ((c - k) * PART + b - j) * PART - i
            for a in range(i, min(i + PART, nx)):
                n = first + a
                z, u, v = ahead[n], right[n], down[n]
                is_open = (here[a] > 0) | (z + 0.5 * voxel_m < farthest)
                is_open &= (here[a] > LEAST) & (hits[a] == 0)
                is_inside = (u >= 0) & (v >= 0) & (u < width) & (v < height)
                asked[count] = n
                count += is_open & is_inside & (z >= NEAREST_M) & (z <= far_m)
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def _most_see_through(image, u, v, half_px, through):
    """Whether most pixels up to `half_px` from (u, v) saw farther than `through`."""
    height, width = image.depth.shape
    reach = int(half_px + 0.5)
    step = reach // _SIDE_SAMPLES + 1
    row, first = max(v - reach, 0), max(u - reach, 0)
    below, end = min(v + reach + 1, height), min(u + reach + 1, width)
    total = beyond = 0
    # numba's range divides to count the turns of a loop with a step, which takes as long as the loop
    while row < below:
        pixels, column = image.depth[row], first
        while column < end:
            total += 1
            beyond += pixels[column] > through
            column += step
        row += step
    return beyond >= _THROUGH * total
