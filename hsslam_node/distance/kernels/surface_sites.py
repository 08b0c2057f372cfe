"""The occupied voxels of a grid as sites of a distance transform, and distances to their surfaces."""

import numpy as np

from hsslam_node.distance.kernels.distance_transform import no_site
from hsslam_node.distance.kernels.surface_record import HEIGHT, NORMAL, STEPS
from hsslam_node.distance.states import FREE, OCCUPIED, UNKNOWN
from hsslam_node.kernels.compiled import njit
from hsslam_node.kernels.simd import WIDTH, load, spread
from hsslam_node.kernels.simd_keys import largest_key, masked_keys, where_less
from hsslam_node.kernels.simd_rows import store_columns

_RADIUS = 0.5  # voxels, of the disc that a site is


# Columns of a table of sites, [S, 8] float32. Places are of the surface in the voxel, in fractional
# indices; normals are of unit length, towards the cameras.
_PLACE_X, _PLACE_Y, _PLACE_Z, _NORMAL_X, _NORMAL_Y, _NORMAL_Z = range(6)
SITE_COLUMNS = 8


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
            if most == OCCUPIED:
                for i in range(nx):
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
def number_sites(states, surface, low, none, keys, sites):
    """Write sites and the keys that a transform starts from.

    Args:
        states: [nz, ny, nx], of a box.
        surface: records of `surface_record.py`, of the whole grid.
        low: [3], where the box begins (z, y, x).
        none: key of a voxel that is no site.
        keys: [nz, ny, width] uint32 or uint64.
        sites: [S, SITE_COLUMNS] float32.
    """
    nz, ny, nx = states.shape
    count = 0
    places = np.empty(nx + 1, np.int64)
    for k in range(nz):
        for j in range(ny):
            keys[k, j] = none
            row = states[k, j]
            most = np.uint8(0)
            for i in range(nx):
                most = max(most, row[i])
            if most < OCCUPIED:
                continue
            found = 0
            for i in range(nx):
                places[found] = i
                found += row[i] == OCCUPIED
            for i in places[:found]:
                keys[k, j, i] = count
                record = surface[low[0] + k, low[1] + j, low[2] + i]
                n0 = np.float32(record[NORMAL])
                n1 = np.float32(record[NORMAL + 1])
                n2 = np.float32(record[NORMAL + 2])
                scale = np.float32(1.0) / max(np.sqrt(n0 * n0 + n1 * n1 + n2 * n2), np.float32(1.0))
                height = np.float32(record[HEIGHT]) * np.float32(1.0 / STEPS)
                n0, n1, n2 = n0 * scale, n1 * scale, n2 * scale
                site = sites[count]
                site[_PLACE_X], site[_NORMAL_X] = i + height * n0, n0
                site[_PLACE_Y], site[_NORMAL_Y] = j + height * n1, n1
                site[_PLACE_Z], site[_NORMAL_Z] = k + height * n2, n2
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
def signed_distances(keys, bits, far, states, sites, voxel_m, low, distance):
    """Write distances, m, to a disc in the nearest site; negative behind it, in its voxel and beside that.

    The disc lies in the plane of the surface, about the foot of the voxel's middle, and is a voxel wide.
    Free voxels without a key are `far` voxels away; the distance of others is nan.

    Args:
        states: [nz, ny, nx], of a box, as are the keys.
        sites: as `number_sites` writes them, one or more.
        low: [3], where the box begins (z, y, x).
        distance: float32, of the whole grid.
    """
    nz, ny, nx = states.shape
    width = keys.shape[2]
    kind = keys.dtype.type
    none = kind(no_site(far, bits))
    mask, no_key = spread(kind((1 << bits) - 1)), spread(none)
    nearest = np.zeros((SITE_COLUMNS, width), np.float32)
    for k in range(nz):
        for j in range(ny):
            found = False
            for start in range(0, width, WIDTH):
                key = load(keys, (k * ny + j) * width + start)
                is_found = where_less(key, no_key, no_key, spread(kind(0)))
                if largest_key(is_found) > 0:
                    found = True
                    store_columns(nearest, start, width, sites, masked_keys(key, mask))
            out = distance[low[0] + k, low[1] + j, low[2] : low[2] + nx]
            if found:
                _to_discs(keys[k, j], bits, none, states[k, j], nearest, j, k, far, voxel_m, out)
            else:
                for i in range(nx):
                    out[i] = np.float32(far * voxel_m) if states[k, j, i] == FREE else np.nan


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
