"""The occupied voxels of a grid as sites of a distance transform, and distances to their surfaces."""

from typing import NamedTuple

import numpy as np
from numba import njit

from hsslam_node.distance.kernels.surface_record import HEIGHT, NORMAL, STEPS
from hsslam_node.distance.states import FREE, OCCUPIED, UNKNOWN

_RADIUS = 0.5  # voxels, of the disc that a site is


class Sites(NamedTuple):
    """One row for each occupied voxel; indices are (x, y, z), fractional."""

    place: np.ndarray  # [S, 3] float32, of the surface in the voxel
    normal: np.ndarray  # [S, 3] float32, unit length, towards the cameras


@njit(cache=True, nogil=True, error_model="numpy")
def known_box(states, box):
    """Number of the occupied voxels of states [nz, ny, nx]; `box` [2, 3]: where the known ones begin and end.

    The box is one voxel wider to all sides, as far as the grid goes, and in the order z, y, x.
    """
    nz, ny, nx = states.shape
    low_z, low_y, low_x = nz, ny, nx
    high_z = high_y = high_x = 0
    count = 0
    in_column = np.zeros(nx, np.uint8)
    for k in range(nz):
        for j in range(ny):
            row = states[k, j]
            most = np.uint8(0)
            for i in range(nx):
                most = max(most, row[i])
                in_column[i] |= row[i]
                count += row[i] == OCCUPIED
            if most > UNKNOWN:
                low_z, high_z = min(low_z, k), k + 1
                low_y, high_y = min(low_y, j), max(high_y, j + 1)
    for i in range(nx):
        if in_column[i]:
            low_x, high_x = min(low_x, i), i + 1
    box[0, 0], box[1, 0] = max(low_z - 1, 0), min(high_z + 1, nz)
    box[0, 1], box[1, 1] = max(low_y - 1, 0), min(high_y + 1, ny)
    box[0, 2], box[1, 2] = max(low_x - 1, 0), min(high_x + 1, nx)
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def number_sites(states, surface, low, none, keys, place, normal):
    """Write sites and the keys that a transform starts from.

    Args:
        states: [nz, ny, nx], of a box.
        surface: records of `surface_record.py`, of the whole grid.
        low: [3], where the box begins (z, y, x).
        none: key of a voxel that is no site.
        keys: [nz, ny, width] uint32.
        place, normal: of `Sites`.
    """
    nz, ny, nx = states.shape
    count = 0
    for k in range(nz):
        for j in range(ny):
            keys[k, j] = none
            row = states[k, j]
            most = np.uint8(0)
            for i in range(nx):
                most = max(most, row[i])
            if most < OCCUPIED:
                continue
            for i in range(nx):
                if row[i] != OCCUPIED:
                    continue
                keys[k, j, i] = count
                record = surface[low[0] + k, low[1] + j, low[2] + i]
                n0 = np.float32(record[NORMAL])
                n1 = np.float32(record[NORMAL + 1])
                n2 = np.float32(record[NORMAL + 2])
                scale = np.float32(1.0) / max(np.sqrt(n0 * n0 + n1 * n1 + n2 * n2), np.float32(1.0))
                height = np.float32(record[HEIGHT]) * np.float32(1.0 / STEPS)
                normal[count, 0], normal[count, 1], normal[count, 2] = (
                    n0 * scale,
                    n1 * scale,
                    n2 * scale,
                )
                place[count, 0] = i + height * normal[count, 0]
                place[count, 1] = j + height * normal[count, 1]
                place[count, 2] = k + height * normal[count, 2]
                count += 1


@njit(cache=True, nogil=True, error_model="numpy")
def mark_near_known(states, needed):
    """Mark the known voxels, and the others that touch them; `needed` [nz, ny, width] uint8."""
    nz, ny, nx = states.shape
    line = np.zeros(nx + 2, np.uint8)
    planes = np.zeros((3, ny, nx), np.uint8)  # of three k: marks grown along x and y
    needed[:] = 0
    for k in range(nz + 1):
        grown = planes[k % 3]
        grown[:] = 0
        if k < nz:
            for j in range(ny):
                for i in range(nx):
                    line[i + 1] = states[k, j, i] != UNKNOWN
                for b in range(max(j - 1, 0), min(j + 2, ny)):
                    row = grown[b]
                    for i in range(nx):
                        row[i] |= line[i] | line[i + 1] | line[i + 2]
        if k > 0:
            for j in range(ny):
                row, a, b, c = needed[k - 1, j], planes[0, j], planes[1, j], planes[2, j]
                for i in range(nx):
                    row[i] = a[i] | b[i] | c[i]


@njit(cache=True, nogil=True, error_model="numpy")
def signed_distances(keys, bits, far, states, place, normal, voxel_m, low, distance):
    """Write distances, m, to a disc in the nearest site; negative behind it, in its voxel and beside that.

    The disc lies in the plane of the surface, about the foot of the voxel's middle, and is a voxel wide.
    Free voxels without a key are `far` voxels away; others stay as they are.

    Args:
        states: [nz, ny, nx], of a box, as are the keys.
        low: [3], where the box begins (z, y, x).
        distance: float32, of the whole grid.
    """
    nz, ny, nx = states.shape
    mask = np.uint32((1 << bits) - 1)
    none = np.uint32((far * far + 1) << bits)
    radius, zero = np.float32(_RADIUS), np.float32(0.0)
    for k in range(nz):
        for j in range(ny):
            out = distance[low[0] + k, low[1] + j, low[2] : low[2] + nx]
            for i in range(nx):
                key, state = keys[k, j, i], states[k, j, i]
                if key >= none:
                    if state == FREE:
                        out[i] = np.float32(far * voxel_m)
                    continue
                s = key & mask
                x = np.float32(i) - place[s, 0]
                y = np.float32(j) - place[s, 1]
                z = np.float32(k) - place[s, 2]
                height = x * normal[s, 0] + y * normal[s, 1] + z * normal[s, 2]
                if state == OCCUPIED:
                    away = height
                else:
                    aside = np.sqrt(max(x * x + y * y + z * z - height * height, zero))
                    aside = max(aside - radius, zero)
                    away = np.sqrt(height * height + aside * aside)
                    is_beside = key >> bits <= 3
                    if state != FREE and is_beside and height < zero:
                        away = -away
                out[i] = min(away, np.float32(far)) * np.float32(voxel_m)
