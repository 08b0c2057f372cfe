"""Voxels that a depth image saw through: in front of what its pixels measured."""

import numpy as np

from hsslam_node.distance.kernels.depth_extremes import TILE_PX
from hsslam_node.distance.kernels.hits import LEAST
from hsslam_node.distance.kernels.passed_voxels import (
    NEAREST_M,
    PART,
    pass_voxels,
    place_voxels,
    steps_in_part,
)
from hsslam_node.kernels.compiled import njit

_BLOCK = 8  # voxels along a side; a block that is not seen through as a whole is cut once
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
    steps = steps_in_part(image, A)
    places, asked = np.empty((3, PART**3)), np.empty(PART**3, np.int64)
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
                            i + part % 2 * PART,
                            j + part // 2 % 2 * PART,
                            k + part // 4 * PART,
                        )
                        if a >= nx or b >= ny or c >= nz:
                            continue
                        if _is_beside(sides, a, b, c, PART):
                            continue
                        if _is_at_least(a, b, c, PART, evidence):
                            continue
                        word, farthest = _word_of_block(image, A, a, b, c, PART, far_m, True)
                        if word == _THROUGHOUT:
                            _pass_block(a, b, c, PART, evidence)
                        elif word == _MIXED:
                            place_voxels(image, A, a, b, c, steps, places)
                            pass_voxels(
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
    if z + reach_z < NEAREST_M or z - reach_z > far_m:
        return _OUTSIDE, none
    if z - reach_z < NEAREST_M:
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
