"""The nearest occupied voxel of every voxel, exactly, up to a distance.

Three passes, along y, x and z, over keys: the squared distance in voxels above the number of a site.
The least key belongs to the nearest site, so its number comes with its distance. The second and third
pass compare a voxel with its neighbours along a line until none farther can be nearer (Saito and
Toriwaki 1994), 16 voxels at a time.
"""

import math

import numpy as np

from hsslam_node.kernels.compiled import njit
from hsslam_node.kernels.copy_rows import copy_row
from hsslam_node.kernels.simd import WIDTH, load, spread, store
from hsslam_node.kernels.simd_keys import (
    add_keys,
    any_less,
    largest_key,
    least_keys,
    where_bits,
    where_less,
)

_AT_ONCE = 4  # neighbours to each side that are compared before the next look at what is left


def site_bits(sites: int) -> int:
    """Bits of a key for the number of a site."""
    return max(sites - 1, 1).bit_length()


def key_type(far: int, bits: int) -> type[np.unsignedinteger]:
    """The kind of keys that hold distances up to `far` voxels above `bits` bits: 32 bits are quicker."""
    largest = far * far + 1 + (far + _AT_ONCE) ** 2  # that is compared
    return np.uint32 if (largest + 1) << bits < 1 << 32 else np.uint64


def padded_width(nx: int) -> int:
    """Length of the rows of keys and masks: whole vectors."""
    return WIDTH * math.ceil(nx / WIDTH)


def marks(mask: np.ndarray) -> np.ndarray:
    """A mask [..., nx] as bits [..., padded width / 16] uint16, the lowest first."""
    nx = mask.shape[-1]
    padded = np.zeros((*mask.shape[:-1], padded_width(nx)), np.bool_)
    padded[..., :nx] = mask
    return np.packbits(padded, axis=-1, bitorder="little").view("<u2")


@njit(cache=True, nogil=True, error_model="numpy")
def nearest_sites(keys, needed, far, bits):
    """Fill in, in place, the keys of the voxels that are needed, up to `far` voxels from a site.

    The keys of voxels that are not needed, and of those farther from all sites, end as `no_site`.

    Args:
        keys: [nz, ny, width] of `key_type`; a site has its number, another voxel `no_site`.
        needed: [nz, ny, width / 16] uint16, a bit for each voxel, the lowest first (`marks`).
        far: voxels.
        bits: of the number of a site.
    """
    nz, ny, width = keys.shape
    kind = keys.dtype.type
    _sweep_y(keys, far, bits)
    none = kind(no_site(far, bits))
    reach = min(far, nz - 1)
    column = np.full((nz + 2 * (reach + _AT_ONCE), WIDTH), none, keys.dtype)
    margin = far + _AT_ONCE
    line = np.full(width + 2 * margin, none, keys.dtype)
    least = np.full(width + 2 * margin, none, keys.dtype)
    limit = np.empty(width // WIDTH, keys.dtype)
    for j in range(ny):
        _limits(keys, needed, j, limit)
        for k in range(nz):
            copy_row(keys[k, j], line[margin : margin + width])
            _least_of_four(line[margin - 3 :], least[margin - 3 : margin + width])
            _along_x(line, least, limit, far, bits, keys[k, j])
        for group in range(len(limit)):
            if limit[group] > 0:
                _along_z(keys, needed, j, group, column, none, reach, bits)


@njit(cache=True, nogil=True, error_model="numpy")
def _limits(keys, needed, j, limit):
    """One more than the largest key that is needed in each 16 columns (j, i), 0 if none is."""
    nz, ny, width = keys.shape
    kind = keys.dtype.type
    zero, one = spread(kind(0)), spread(kind(1))
    for group in range(len(limit)):
        most = zero
        for k in range(nz):
            at = (k * ny + j) * width + group * WIDTH
            key = where_bits(needed[k, j, group], add_keys(load(keys, at), one), zero)
            most = where_less(most, key, key, most)
        limit[group] = largest_key(most)


@njit(cache=True, nogil=True, error_model="numpy")
def no_site(far, bits):
    """The key of a voxel that has no site within `far` voxels."""
    return (far * far + 1) << bits


@njit(cache=True, nogil=True, error_model="numpy")
def _sweep_y(keys, far, bits):
    """Nearest sites along y, by a sweep to and fro."""
    nz, ny, width = keys.shape
    kind = keys.dtype.type
    none, zero = spread(kind(no_site(far, bits))), spread(kind(0))
    one, two = spread(kind(1 << bits)), spread(kind(2 << bits))
    for k in range(nz):
        for start in range(0, width, WIDTH):
            for sweep in range(2):
                last, square, odd = zero, none, none
                for step in range(ny):
                    j = step if sweep == 0 else ny - 1 - step
                    at = (k * ny + j) * width + start
                    key = load(keys, at)
                    last = where_less(key, one, key, last)
                    square = where_less(key, one, zero, least_keys(add_keys(square, odd), none))
                    odd = where_less(key, one, one, least_keys(add_keys(odd, two), none))
                    store(keys, at, least_keys(key, least_keys(add_keys(last, square), none)))


@njit(cache=True, nogil=True, error_model="numpy")
def _least_of_four(line, least):
    """Write the least key of each one of a line and the three that follow it."""
    for n in range(len(least)):
        least[n] = min(min(line[n], line[n + 1]), min(line[n + 2], line[n + 3]))


@njit(cache=True, nogil=True, error_model="numpy")
def _along_x(line, least, limit, far, bits, out):
    """Nearest sites among those of a line, [width]; none that is farther than the limit of its 16 columns.

    `least`: of each key of the line and the three that follow, so that one look shows that none of four
    neighbours is nearer.
    """
    kind = line.dtype.type
    none = spread(kind(no_site(far, bits)))
    for group in range(len(limit)):
        start = group * WIDTH
        if limit[group] == 0:
            store(out, start, none)
            continue
        at = far + _AT_ONCE + start
        best = load(line, at)
        most = min(limit[group], largest_key(best))
        for first in range(1, far + 1, _AT_ONCE):
            if kind((first * first) << bits) > most:
                break
            last = first + _AT_ONCE - 1
            nearest = least_keys(load(least, at - last), load(least, at + first))
            if not any_less(add_keys(nearest, spread(kind((first * first) << bits))), best):
                continue
            for d in range(first, first + _AT_ONCE):
                nearer = least_keys(load(line, at - d), load(line, at + d))
                best = least_keys(best, add_keys(nearer, spread(kind((d * d) << bits))))
            most = min(most, largest_key(best))
        store(out, start, best)


@njit(cache=True, nogil=True, error_model="numpy")
def _along_z(keys, needed, j, group, column, no_key, reach, bits):
    """Nearest sites among those of the 16 columns (j, i) of a group, in place.

    `column` [nz + 2 (reach + 4), 16]: room for a copy, between rows of `no_key`.
    """
    nz, ny, width = keys.shape
    kind = keys.dtype.type
    zero, none = spread(kind(0)), spread(no_key)
    margin, start = reach + _AT_ONCE, group * WIDTH
    for k in range(nz):
        store(column, (margin + k) * WIDTH, load(keys, (k * ny + j) * width + start))
    for k in range(nz):
        place, at = (k * ny + j) * width + start, (margin + k) * WIDTH
        asked = needed[k, j, group]
        if asked == 0:
            store(keys, place, none)
            continue
        best = where_bits(asked, load(column, at), zero)
        most = largest_key(best)
        for first in range(1, reach + 1, _AT_ONCE):
            if kind((first * first) << bits) > most:
                break
            for d in range(first, first + _AT_ONCE):
                nearer = least_keys(load(column, at - d * WIDTH), load(column, at + d * WIDTH))
                best = least_keys(best, add_keys(nearer, spread(kind((d * d) << bits))))
            most = min(most, largest_key(best))
        store(keys, place, least_keys(where_bits(asked, best, none), none))
