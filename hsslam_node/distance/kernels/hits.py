"""Depth pixels gathered in the voxels that they end in: which voxels hold a surface, and where in them."""

from typing import NamedTuple

import numpy as np

from hsslam_node.distance.kernels.surface_record import STEPS, WEIGHT, fit_plane
from hsslam_node.kernels.compiled import njit

MOST, LEAST = 5, -3  # evidence of a voxel: free below 0
OCCUPIED_FROM = 2
_STRONG, _WEAK = 2, 1  # what a hit adds; a pass takes one
_STRONG_SHARE, _WEAK_SHARE = 0.5, 0.15  # of the pixels that the voxel's side would fill
_IN_VOXEL = 0.55  # of its side, from its middle: what lies between two voxels is in one of them
_SPREAD_M = 0.2  # of pixels that see one surface: no hit is made of the nearer ones alone
_FEWEST_PX = 2.0
_UNIT_M = 4.0  # a hit at this distance has weight 1, a nearer one more: depth noise grows with z^2
_MOST_HIT = 15.0  # weight of a hit
_MOST_WEIGHT = 120.0  # of a place, which goes on following hits
_STILL = 2  # steps: a place that moves no more leaves its plane as it is

_INDEX = (1 << 20) - 1  # mask of one of the three in `Touched.voxel`


class Touched(NamedTuple):
    """Voxels that one image's pixels end in; kept between images, as it is large."""

    slot: np.ndarray  # [nz, ny, nx] int32, 0: none
    voxel: np.ndarray  # [slots] int64, indices x, y, z in 20 bits each; slot 0 is not used
    sums: np.ndarray  # [slots, 4] float32: offsets of the points from the middle, voxels; how many
    moved: np.ndarray  # [slots] bool, the place of the surface


def touched(shape: tuple[int, ...], pixels: int) -> Touched:
    """For a grid of shape (nz, ny, nx) and images of this many pixels."""
    slots = pixels + 1
    return Touched(
        np.zeros(shape, np.int32),
        np.zeros(slots, np.int64),
        np.zeros((slots, 4), np.float32),
        np.zeros(slots, np.bool_),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def gather_hits(image, T_index_cam, far_m, touched):
    """Sum up the pixels up to a little beyond `far_m` in their voxels; returns the number of slots used.

    Args:
        image: `DepthExtremes`.
        T_index_cam: [3, 4], camera, m, to fractional indices (x, y, z) of voxels.
    """
    T = T_index_cam
    nz, ny, nx = touched.slot.shape
    height, width = image.depth.shape
    a = T[:, 0] / image.fx  # voxels per pixel and m
    slots, sums = touched.slot.reshape(-1), touched.sums
    inside, offsets = np.empty(width, np.int32), np.empty((3, width), np.float32)
    used = 0
    for row in range(height):
        down = (row - image.cy) / image.fy
        b = T[:, 1] * down + T[:, 2] - a * image.cx
        _place_pixels(image.depth[row], a, b, T[:, 3].copy(), (nz, ny, nx), far_m, inside, offsets)
        for column in range(width):
            at = inside[column]
            if at < 0:
                continue
            s = slots[at]
            if s == 0:
                used += 1
                s = used
                slots[at] = s
                k, rest = divmod(at, ny * nx)
                touched.voxel[s] = (k << 40) | (rest // nx << 20) | rest % nx
                sums[s] = 0.0
            sums[s, 0] += offsets[0, column]
            sums[s, 1] += offsets[1, column]
            sums[s, 2] += offsets[2, column]
            sums[s, 3] += np.float32(1.0)
    return used


@njit(cache=True, nogil=True, error_model="numpy")
def _place_pixels(depth, a, b, start, shape, far_m, inside, offsets):
    """Write the voxels of a row of pixels, counted in memory, below 0: none, and the places in them.

    A pixel lies at `(a column + b) depth + start`, in fractional indices (x, y, z), [3] each.
    """
    nz, ny, nx = shape
    end = far_m + _SPREAD_M
    x, y, z = offsets[0], offsets[1], offsets[2]
    a0, a1, a2, b0, b1, b2 = a[0], a[1], a[2], b[0], b[1], b[2]
    t0, t1, t2 = start[0], start[1], start[2]
    for column in range(len(inside)):
        d = depth[column]
        p0 = (a0 * column + b0) * d + t0
        p1 = (a1 * column + b1) * d + t1
        p2 = (a2 * column + b2) * d + t2
        i, j, k = np.floor(p0 + 0.5), np.floor(p1 + 0.5), np.floor(p2 + 0.5)
        x[column], y[column], z[column] = p0 - i, p1 - j, p2 - k
        is_inside = (d != 0.0) & (d < end) & (i >= 0) & (j >= 0) & (k >= 0)
        is_inside &= (i < nx) & (j < ny) & (k < nz)
        inside[column] = np.int32((k * ny + j) * nx + i) if is_inside else np.int32(-1)


@njit(cache=True, nogil=True, error_model="numpy")
def add_hits(image, T_index_cam, voxel_m, far_m, touched, used, evidence, surface):
    """Add to the evidence of voxels that hold the surface of their pixels, and move its place.

    A voxel is taken together with the one before and the one behind it: noise spreads a surface over
    them, and their mean lies in one. Slots of voxels without a hit become 0.

    Args:
        T_index_cam: as for `gather_hits`.
        evidence: [nz, ny, nx] int8.
        surface: [nz, ny, nx, 8] int8, records of `surface_record.py`.
    """
    T = T_index_cam
    place, ray = np.empty(3), np.empty(3)
    for s in range(1, used + 1):
        voxel = touched.voxel[s]
        i, j, k = voxel & _INDEX, (voxel >> 20) & _INDEX, voxel >> 40
        r0, r1, r2 = i - T[0, 3], j - T[1, 3], k - T[2, 3]  # from the camera, voxels
        ahead = (T[0, 2] * r0 + T[1, 2] * r1 + T[2, 2] * r2) * voxel_m * voxel_m
        axis = 0 if abs(r0) >= max(abs(r1), abs(r2)) else 1 if abs(r1) >= abs(r2) else 2
        count = _mean_place(touched, i, j, k, axis, place)
        side_px2 = image.fx * image.fy * (voxel_m / max(ahead, voxel_m)) ** 2
        before = evidence[k, j, i]
        is_enough = ahead < far_m and count >= max(_FEWEST_PX, _WEAK_SHARE * side_px2)
        if not is_enough or abs(place[axis]) > _IN_VOXEL:
            touched.voxel[s] = ~voxel
            continue
        weight = min(max((_UNIT_M / ahead) ** 4, 1.0), _MOST_HIT)
        total = weight + (surface[k, j, i, WEIGHT] if before > 0 else 0)
        moved = before < OCCUPIED_FROM
        for a in range(3):
            step = weight / total * (STEPS * place[a] - surface[k, j, i, a])
            there = np.int8(np.floor(surface[k, j, i, a] + step + 0.5))
            moved |= abs(there - surface[k, j, i, a]) > _STILL
            surface[k, j, i, a] = there
        surface[k, j, i, WEIGHT] = np.int8(min(total, _MOST_WEIGHT))
        touched.moved[s] = moved
        word = _STRONG if count >= _STRONG_SHARE * side_px2 else _WEAK
        evidence[k, j, i] = min(before + word, MOST)
    for s in range(1, used + 1):
        voxel = touched.voxel[s]
        if voxel < 0:
            voxel = ~voxel
            touched.voxel[s] = voxel
            touched.slot[voxel >> 40, (voxel >> 20) & _INDEX, voxel & _INDEX] = 0
            continue
        if not touched.moved[s]:
            continue
        i, j, k = voxel & _INDEX, (voxel >> 20) & _INDEX, voxel >> 40
        ray[0], ray[1], ray[2] = T[0, 3] - i, T[1, 3] - j, T[2, 3] - k
        fit_plane(evidence, surface, i, j, k, OCCUPIED_FROM, ray)


@njit(cache=True, nogil=True, error_model="numpy")
def _mean_place(touched, i, j, k, axis, place):
    """Write the mean of the pixels in a voxel and its neighbours along an axis; returns their number."""
    nz, ny, nx = touched.slot.shape
    count = 0.0
    place[:] = 0.0
    for step in range(-1, 2):
        a = i + step if axis == 0 else i
        b = j + step if axis == 1 else j
        c = k + step if axis == 2 else k
        if a < 0 or b < 0 or c < 0 or a >= nx or b >= ny or c >= nz:
            continue
        s = touched.slot[c, b, a]
        if s == 0:
            continue
        pixels = touched.sums[s, 3]
        count += pixels
        for n in range(3):
            place[n] += touched.sums[s, n]
        place[axis] += step * pixels
    place /= count
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def forget_hits(touched, used):
    """Make all slots 0 again."""
    for s in range(1, used + 1):
        voxel = touched.voxel[s]
        touched.slot[voxel >> 40, (voxel >> 20) & _INDEX, voxel & _INDEX] = 0
