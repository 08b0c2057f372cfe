"""Voxels that a depth image saw through: in front of what its pixels measured."""

import numpy as np

from hsslam_node.distance.kernels.depth_extremes import REACHES_PX, TILE_PX
from hsslam_node.distance.kernels.hits import LEAST
from hsslam_node.kernels.compiled import njit

_BLOCK = 8  # voxels along a side; a block that is not seen through as a whole is cut once
_PART = 4
_NEAREST_M = 0.1
_SIDE_SAMPLES = 2  # pixels looked at to each side of an occupied voxel's middle
_THROUGH = 0.8  # share of them that clears it
_OUTSIDE, _BEHIND, _MIXED, _THROUGHOUT = range(4)


@njit(cache=True, nogil=True, error_model="numpy")
def add_passes(image, T_cam_index, voxel_m, far_m, slot, evidence):
    """Take one from the evidence of voxels that were seen through.

    Args:
        image: `DepthExtremes`.
        T_cam_index: [3, 4], fractional indices (x, y, z) of voxels to camera, m.
        voxel_m: side of a voxel, m.
        far_m: farther voxels are left as they are.
        slot: [nz, ny, nx] int32, not 0 where the image hit a surface.
        evidence: [nz, ny, nx] int8.
    """
    nz, ny, nx = evidence.shape
    A = T_cam_index
    sides = _frustum(image, A)
    steps = _steps_in_part(image, A)
    places, asked = np.empty((3, _PART**3)), np.empty(_PART**3, np.int64)
    for k in range(0, nz, _BLOCK):
        for j in range(0, ny, _BLOCK):
            for i in range(0, nx, _BLOCK):
                if _is_beside(sides, i, j, k, _BLOCK):
                    continue
                if _is_at_least(i, j, k, _BLOCK, evidence):
                    continue
                word = _word_of_block(image, A, i, j, k, _BLOCK, far_m, False)[0]
                if word == _THROUGHOUT:
                    _pass_block(i, j, k, _BLOCK, evidence)
                elif word == _MIXED:
                    for part in range(8):
                        a, b, c = (
                            i + part % 2 * _PART,
                            j + part // 2 % 2 * _PART,
                            k + part // 4 * _PART,
                        )
                        if a >= nx or b >= ny or c >= nz:
                            continue
                        if _is_beside(sides, a, b, c, _PART):
                            continue
                        if _is_at_least(a, b, c, _PART, evidence):
                            continue
                        word, farthest = _word_of_block(image, A, a, b, c, _PART, far_m, True)
                        if word == _THROUGHOUT:
                            _pass_block(a, b, c, _PART, evidence)
                        elif word == _MIXED:
                            _place_voxels(image, A, a, b, c, steps, places)
                            _pass_voxels(
                                image,
                                places,
                                a,
                                b,
                                c,
                                voxel_m,
                                far_m,
                                farthest,
                                slot,
                                evidence,
                                asked,
                            )


@njit(cache=True, nogil=True, error_model="numpy")
def _word_of_block(image, A, i, j, k, side, far_m, asks_farthest):
    """What the image says of a block of voxels as a whole, from a box about it along the camera's axes.

    Returns that and the farthest depth in the box, m; of a mixed block only if asked, else some depth in it.
    """
    none, unlimited = np.float32(0.0), np.float32(np.inf)
    height, width = image.depth.shape
    half = 0.5 * (side - 1)
    x = A[0, 0] * (i + half) + A[0, 1] * (j + half) + A[0, 2] * (k + half) + A[0, 3]
    y = A[1, 0] * (i + half) + A[1, 1] * (j + half) + A[1, 2] * (k + half) + A[1, 3]
    z = A[2, 0] * (i + half) + A[2, 1] * (j + half) + A[2, 2] * (k + half) + A[2, 3]
    reach = 0.5 * side
    reach_x = reach * (abs(A[0, 0]) + abs(A[0, 1]) + abs(A[0, 2]))
    reach_y = reach * (abs(A[1, 0]) + abs(A[1, 1]) + abs(A[1, 2]))
    reach_z = reach * (abs(A[2, 0]) + abs(A[2, 1]) + abs(A[2, 2]))
    if z + reach_z < _NEAREST_M or z - reach_z > far_m:
        return _OUTSIDE, none
    if z - reach_z < _NEAREST_M:
        return _MIXED, unlimited
    per_near, per_far = 1.0 / (z - reach_z), 1.0 / (z + reach_z)
    u_low = (x - reach_x) * (per_near if x < reach_x else per_far)
    u_high = (x + reach_x) * (per_near if x > -reach_x else per_far)
    v_low = (y - reach_y) * (per_near if y < reach_y else per_far)
    v_high = (y + reach_y) * (per_near if y > -reach_y else per_far)
    u0, u1 = u_low * image.fx + image.cx + 0.5, u_high * image.fx + image.cx + 0.5
    v0, v1 = v_low * image.fy + image.cy + 0.5, v_high * image.fy + image.cy + 0.5
    if u1 < 0 or v1 < 0 or u0 >= width or v0 >= height:
        return _OUTSIDE, none
    is_whole = u0 >= 0 and v0 >= 0 and u1 < width and v1 < height and z + reach_z <= far_m
    nearest, farthest = unlimited, none
    for r in range(max(int(v0), 0) // TILE_PX, min(int(v1), height - 1) // TILE_PX + 1):
        for c in range(max(int(u0), 0) // TILE_PX, min(int(u1), width - 1) // TILE_PX + 1):
            nearest = min(nearest, image.tile_nearest[r, c])
            farthest = max(farthest, image.tile_farthest[r, c])
        is_mixed = farthest >= z - reach_z and not (is_whole and nearest > z + reach_z)
        if is_mixed and not asks_farthest:
            return _MIXED, farthest
    if farthest < z - reach_z:
        return _BEHIND, farthest
    if is_whole and nearest > z + reach_z:
        return _THROUGHOUT, farthest
    return _MIXED, farthest


@njit(cache=True, nogil=True, error_model="numpy")
def _is_at_least(i, j, k, side, evidence):
    """Whether all voxels of a block have the least evidence, so that no pass changes them."""
    nz, ny, nx = evidence.shape
    for c in range(k, min(k + side, nz)):
        for b in range(j, min(j + side, ny)):
            row = evidence[c, b]
            most = row[i]
            for a in range(i + 1, min(i + side, nx)):
                most = max(most, row[a])
            if most > LEAST:
                return False
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _pass_block(i, j, k, side, evidence):
    nz, ny, nx = evidence.shape
    for c in range(k, min(k + side, nz)):
        for b in range(j, min(j + side, ny)):
            row = evidence[c, b]
            for a in range(i, min(i + side, nx)):
                row[a] = max(row[a] - 1, LEAST)


@njit(cache=True, nogil=True, error_model="numpy")
def _frustum(image, A):
    """The four sides of what is in the image, [4, 5].

    The first four numbers of a side give, with indices (x, y, z, 1) of a voxel, how far inside it is, in any
    unit; the last one how much that changes within half a voxel, at most.
    """
    height, width = image.depth.shape
    sides = np.empty((4, 5))
    for a in range(4):
        u, v = image.fx * A[0, a], image.fy * A[1, a]
        sides[0, a] = u + (image.cx + 0.5) * A[2, a]
        sides[1, a] = (width - image.cx - 0.5) * A[2, a] - u
        sides[2, a] = v + (image.cy + 0.5) * A[2, a]
        sides[3, a] = (height - image.cy - 0.5) * A[2, a] - v
    for side in range(4):
        sides[side, 4] = 0.5 * np.abs(sides[side, :3]).sum()
    return sides


@njit(cache=True, nogil=True, error_model="numpy")
def _is_beside(sides, i, j, k, side):
    """Whether a block of voxels ahead of the camera lies outside the image as a whole."""
    half = 0.5 * (side - 1)
    x, y, z = i + half, j + half, k + half
    for n in range(4):
        inside = sides[n, 0] * x + sides[n, 1] * y + sides[n, 2] * z + sides[n, 3]
        if inside + side * sides[n, 4] < 0:
            return True
    return False


@njit(cache=True, nogil=True, error_model="numpy")
def _steps_in_part(image, A):
    """Along x, y (pixels times m) and z (m) of the camera, from a part's first voxel to each, [3, 64]."""
    steps = np.empty((3, _PART**3))
    scale = (image.fx, image.fy, 1.0)
    for n in range(_PART**3):
        a, b, c = n % _PART, n // _PART % _PART, n // _PART**2
        for axis in range(3):
            steps[axis, n] = scale[axis] * (A[axis, 0] * a + A[axis, 1] * b + A[axis, 2] * c)
    return steps


@njit(cache=True, nogil=True, error_model="numpy")
def _place_voxels(image, A, i, j, k, steps, places):
    """Write column and row in the image, and depth, m, of the middles of a part's voxels, [3, 64]."""
    u_0 = (A[0, 0] * i + A[0, 1] * j + A[0, 2] * k + A[0, 3]) * image.fx
    v_0 = (A[1, 0] * i + A[1, 1] * j + A[1, 2] * k + A[1, 3]) * image.fy
    z_0 = A[2, 0] * i + A[2, 1] * j + A[2, 2] * k + A[2, 3]
    u_steps, v_steps, z_steps = steps[0], steps[1], steps[2]
    right, down, ahead = places[0], places[1], places[2]
    u_middle, v_middle = image.cx + 0.5, image.cy + 0.5
    for n in range(_PART**3):
        z = z_0 + z_steps[n]
        per_z = 1.0 / z
        ahead[n] = z
        right[n] = (u_0 + u_steps[n]) * per_z + u_middle
        down[n] = (v_0 + v_steps[n]) * per_z + v_middle


@njit(cache=True, nogil=True, error_model="numpy")
def _pass_voxels(image, places, i, j, k, voxel_m, far_m, farthest, slot, evidence, asked):
    """The voxels of a part one by one; none of its pixels saw farther than `farthest`, m.

    `asked` [64] int64: room for the numbers of the voxels that are looked for in the image. They are chosen
    without branches, as no processor could foresee them.
    """
    half_px = 0.5 * voxel_m * max(image.fx, image.fy)  # of a voxel 1 m away
    right, down, ahead = places[0], places[1], places[2]
    for n in asked[: _ask(image, places, i, j, k, voxel_m, far_m, farthest, slot, evidence, asked)]:
        a, b, c = i + n % _PART, j + n // _PART % _PART, k + n // _PART**2
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
    for c in range(k, min(k + _PART, nz)):
        for b in range(j, min(j + _PART, ny)):
            here, hits = evidence[c, b], slot[c, b]
            first = ((c - k) * _PART + b - j) * _PART - i
            for a in range(i, min(i + _PART, nx)):
                n = first + a
                z, u, v = ahead[n], right[n], down[n]
                is_open = (here[a] > 0) | (z + 0.5 * voxel_m < farthest)
                is_open &= (here[a] > LEAST) & (hits[a] == 0)
                is_inside = (u >= 0) & (v >= 0) & (u < width) & (v < height)
                asked[count] = n
                count += is_open & is_inside & (z >= _NEAREST_M) & (z <= far_m)
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
