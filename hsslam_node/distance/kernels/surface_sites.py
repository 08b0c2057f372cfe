"""The occupied voxels of a grid as sites of a distance transform, and distances to their surfaces."""

import numpy as np

from hsslam_node.distance.kernels.distance_transform import no_site
from hsslam_node.distance.kernels.surface_record import HEIGHT, NORMAL, STEPS
from hsslam_node.distance.states import FREE, OCCUPIED, UNKNOWN
from hsslam_node.kernels.compiled import njit
from hsslam_node.kernels.simd import WIDTH, load, lowest_bit, spread
from hsslam_node.kernels.simd_keys import equal_bits, largest_key, masked_keys, where_less
from hsslam_node.kernels.simd_rows import store_columns

_OCCUPIED, _UNKNOWN = np.uint8(OCCUPIED), np.uint8(UNKNOWN)
_RADIUS = 0.5  # voxels, of the disc that a site is


# Columns of a table of sites, [S, 8] float32. Places are of the surface in the voxel, in fractional
# indices; normals are of unit length, towards the cameras.
_PLACE_X, _PLACE_Y, _PLACE_Z, _NORMAL_X, _NORMAL_Y, _NORMAL_Z = range(6)
SITE_COLUMNS = 8


@njit(cache=True, nogil=True, error_model="numpy")
def number_sites(states, surface, low, none, keys, sites):
    """Write sites and the keys that a transform starts from, of the box that the keys cover.

    Args:
        states: [nz, ny, nx] uint8, of a grid, in the memory of `known_voxels.py`.
        surface: records of `surface_record.py`, of the grid.
        low: [3], where the box begins (z, y, x).
        none: key of a voxel that is no site.
        keys: [box z, box y, width] uint32 or uint64.
        sites: [S, SITE_COLUMNS] float32.
    """
    nz, ny, width = keys.shape
    nx = min(width, states.shape[2] - low[2])
    count = 0
    for k in range(nz):
        for j in range(ny):
            keys[k, j] = none
            start = _offset(states, low, k, j)
            for first in range(0, nx, WIDTH):
                left = np.uint64(_bits_of(states, start, first, nx, _OCCUPIED))
                while left:
                    i = first + lowest_bit(left)
                    left &= left - np.uint64(1)
                    keys[k, j, i] = count
                    _write_site(sites[count], surface[low[0] + k, low[1] + j, low[2] + i], i, j, k)
                    count += 1


@njit(cache=True, nogil=True, error_model="numpy")
def _write_site(site, record, i, j, k):
    """The surface in voxel (i, j, k) of a box, from its record."""
    n0, n1, n2 = (
        np.float32(record[NORMAL]),
        np.float32(record[NORMAL + 1]),
        np.float32(record[NORMAL + 2]),
    )
    scale = np.float32(1.0) / max(np.sqrt(n0 * n0 + n1 * n1 + n2 * n2), np.float32(1.0))
    height = np.float32(record[HEIGHT]) * np.float32(1.0 / STEPS)
    n0, n1, n2 = n0 * scale, n1 * scale, n2 * scale
    site[_PLACE_X], site[_NORMAL_X] = i + height * n0, n0
    site[_PLACE_Y], site[_NORMAL_Y] = j + height * n1, n1
    site[_PLACE_Z], site[_NORMAL_Z] = k + height * n2, n2


@njit(cache=True, nogil=True, error_model="numpy")
def _offset(states, low, k, j):
    """Place in memory of the first voxel of a row of a box."""
    return ((low[0] + k) * states.shape[1] + low[1] + j) * states.shape[2] + low[2]


@njit(cache=True, nogil=True, error_model="numpy")
def _bits_of(states, start, first, nx, state):
    """Which of 16 voxels have a state, from `first` on in the row of `nx` that begins at `start`."""
    inside = np.uint16(0xFFFF) if nx - first >= WIDTH else np.uint16((1 << (nx - first)) - 1)
    return np.uint16(equal_bits(states, start + first, state) & inside)


@njit(cache=True, nogil=True, error_model="numpy")
def mark_near_known(states, low, nx, needed):
    """Mark the known voxels of a box `nx` wide, and the others that touch them, as bits.

    Args:
        states, low: as for `number_sites`.
        needed: [box z, box y, groups of 16 voxels] uint16.
    """
    nz, ny, groups = needed.shape
    rows = np.zeros((nz + 2, ny + 2, groups), np.uint16)  # grown along x, with a margin
    for k in range(nz):
        for j in range(ny):
            start, row = _offset(states, low, k, j), rows[k + 1, j + 1]
            before, here = np.uint32(0), _known_bits(states, start, 0, nx)
            for group in range(groups):
                first = group * WIDTH + WIDTH
                after = _known_bits(states, start, first, nx) if first < nx else np.uint32(0)
                row[group] = here | here << 1 | here >> 1 | before >> 15 | after << 15
                before, here = here, after
    planes = rows.reshape(nz + 2, -1)
    size, inside = ny * groups, np.uint16((1 << (nx - 1) % WIDTH + 1) - 1)  # of the last group
    for k in range(nz):
        out = needed[k].reshape(-1)
        for n in range(size):
            out[n] = 0
        for plane in planes[k : k + 3]:
            a, b, c = plane[:size], plane[groups : groups + size], plane[2 * groups :]
            for n in range(size):
                out[n] |= a[n] | b[n] | c[n]
        needed[k, :, groups - 1] &= inside


@njit(cache=True, nogil=True, error_model="numpy")
def _known_bits(states, start, first, nx):
    """Which of 16 voxels are known, see `_bits_of`."""
    inside = (1 << min(nx - first, WIDTH)) - 1
    return np.uint32(~equal_bits(states, start + first, _UNKNOWN) & inside)


@njit(cache=True, nogil=True, error_model="numpy")
def signed_distances(keys, bits, far, states, sites, voxel_m, low, nx, distance):
    """Write distances, m, to a disc in the nearest site; negative behind it, in its voxel and beside that.

    The disc lies in the plane of the surface, about the foot of the voxel's middle, and is a voxel wide.
    Free voxels without a key are `far` voxels away; the distance of others is nan.

    Args:
        states: [nz, ny, nx] uint8, of the grid.
        sites: as `number_sites` writes them, one or more.
        low: [3], where the box of the keys begins (z, y, x); it is `nx` wide.
        distance: float32, of the grid; outside the box it becomes nan.
    """
    nz, ny, width = keys.shape
    nan = np.float32(np.nan)
    distance[: low[0]] = nan
    distance[low[0] + nz :] = nan
    kind = keys.dtype.type
    none = kind(no_site(far, bits))
    mask, no_key = spread(kind((1 << bits) - 1)), spread(none)
    nearest = np.zeros((SITE_COLUMNS, width), np.float32)
    for k in range(nz):
        distance[low[0] + k, : low[1]] = nan
        distance[low[0] + k, low[1] + ny :] = nan
        for j in range(ny):
            found = False
            for start in range(0, width, WIDTH):
                key = load(keys, (k * ny + j) * width + start)
                is_found = where_less(key, no_key, no_key, spread(kind(0)))
                if largest_key(is_found) > 0:
                    found = True
                    store_columns(nearest, start, width, sites, masked_keys(key, mask))
            line, seen = distance[low[0] + k, low[1] + j], states[low[0] + k, low[1] + j]
            line[: low[2]] = nan
            line[low[2] + nx :] = nan
            out, seen = line[low[2] : low[2] + nx], seen[low[2] : low[2] + nx]
            if found:
                _to_discs(keys[k, j], bits, none, seen, nearest, j, k, far, voxel_m, out)
            else:
                for i in range(nx):
                    out[i] = np.float32(far * voxel_m) if seen[i] == FREE else nan


@njit(cache=True, nogil=True, error_model="numpy")
def _to_discs(keys, bits, none, states, nearest, j, k, far, voxel_m, out):
    """Distances of a row of voxels; `nearest` [SITE_COLUMNS, width] has the site of each that has one."""
    place_x, place_y, place_z = nearest[_PLACE_X], nearest[_PLACE_Y], nearest[_PLACE_Z]
    normal_x, normal_y, normal_z = nearest[_NORMAL_X], nearest[_NORMAL_Y], nearest[_NORMAL_Z]
    beside = keys.dtype.type(4 << bits)
    free, occupied = np.uint8(FREE), np.uint8(OCCUPIED)
    radius, zero, nan = np.float32(_RADIUS), np.float32(0.0), np.float32(np.nan)
    most, side_m, far_m = np.float32(far), np.float32(voxel_m), np.float32(far * voxel_m)
    for i in range(len(out)):
        x = np.float32(i) - place_x[i]
        y = np.float32(j) - place_y[i]
        z = np.float32(k) - place_z[i]
        height = x * normal_x[i] + y * normal_y[i] + z * normal_z[i]
        aside = np.sqrt(max(x * x + y * y + z * z - height * height, zero))
        aside = max(aside - radius, zero)
        away = np.sqrt(height * height + aside * aside)
        is_behind = (states[i] != free) & (keys[i] < beside) & (height < zero)
        away = -away if is_behind else away
        away = height if states[i] == occupied else away
        missing = far_m if states[i] == free else nan
        out[i] = min(away, most) * side_m if keys[i] < none else missing
