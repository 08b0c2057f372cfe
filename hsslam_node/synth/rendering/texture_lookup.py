"""Numba kernels: trilinear texture look-up, and the packed colours it works on."""

from typing import NamedTuple

import numpy as np

from hsslam_node.kernels.compiled import njit

# no freedom to reorder or to fuse: the process that compiles draws what all others draw of the same texels
JIT = {"cache": True, "fastmath": {"nnan", "ninf", "nsz"}, "nogil": True, "error_model": "numpy"}
_RED_BLUE, _GREEN, _BITS = np.uint32(0x00FF00FF), np.uint32(0xFF), np.uint32(8)
_WIDEST = np.float32(60)  # texels; every face has the levels for it


class LookUp(NamedTuple):
    """Scratch for n pixels: the two levels that each pixel mixes, and their four corners."""

    row: np.ndarray  # [n] int32, of the finer level
    density: np.ndarray  # [n] float32, texels per metre of the face
    share: np.ndarray  # [n] uint32, of the coarser level, of 256
    level: np.ndarray  # [3, n] int32: offset, width, height
    place: np.ndarray  # [2, 4, n] int32, into the texels
    weight: np.ndarray  # [2, 4, n] uint32, of 256
    texel: np.ndarray  # [2, 4, n] uint32


@njit(**JIT)
def look_up_of(n):
    """Scratch for n pixels."""
    return LookUp(
        np.empty(n, np.int32),
        np.empty(n, np.float32),
        np.empty(n, np.uint32),
        np.empty((3, n), np.int32),
        np.empty((2, 4, n), np.int32),
        np.empty((2, 4, n), np.uint32),
        np.empty((2, 4, n), np.uint32),
    )


@njit(**JIT)
def sample(texels, levels, first_levels, inverse_texels, face, s, q, width_m, slant, look, out):
    """Colours 0x00BBGGRR [n] at (s, q) in [0, 1]^2 of faces, where a pixel covers `width_m` x `slant`.

    texels [M] uint32 0x00BBGGRR; levels [N, 3] int32: offset, width, height; first_levels [F] int32,
    the row of a face's finest level; inverse_texels [F] float32 1/m. It works in passes over all
    pixels: passes that only compute become vector code.
    """
    for i in range(len(face)):
        look.row[i] = first_levels[face[i]]
        look.density[i] = inverse_texels[face[i]]
    is_one_row, is_mixed = _choose_levels(width_m, slant, look)
    mixed_levels = 2 if is_mixed else 1
    for k in range(mixed_levels):
        place, weight = look.place[k], look.weight[k]
        if is_one_row:
            offset, width, height = levels[look.row[0] + k]
            _find_corners_in_one(s, q, offset, width, height, place, weight)
        else:
            for i in range(len(face)):
                for a in range(3):
                    look.level[a, i] = levels[look.row[i] + k, a]
            _find_corners(s, q, look.level, place, weight)
        for c in range(4):
            texel, at = look.texel[k, c], place[c]
            for i in range(len(face)):
                texel[i] = texels[at[i]]
    if is_mixed:
        _mix(look.texel, look.weight, look.share, out)
    else:
        _mix_corners(look.texel[0], look.weight[0], out)


@njit(**JIT)
def _choose_levels(width_m, slant, look):
    """log2 of the texels that a pixel covers, from the float's exponent and a straight line through
    its mantissa: the row of the finer level, and the share of the coarser one.

    Returns whether all pixels have the same row, and whether any of them mixes two levels.
    """
    for i in range(len(width_m)):
        footprint = min(max(width_m[i] * look.density[i] * slant[i], np.float32(1)), _WIDEST)
        bits = np.float32(footprint).view(np.int32) - np.int32(0x3F800000)
        look.row[i] += bits >> np.int32(23)
        look.share[i] = np.uint32((bits >> np.int32(15)) & np.int32(255))
    other_rows, shares = np.int32(0), np.uint32(0)
    for i in range(len(width_m)):
        other_rows |= look.row[i] ^ look.row[0]
        shares |= look.share[i]
    return other_rows == 0, shares > 0


@njit(**JIT)
def _find_corners(s, q, level, place, weight):
    """Places and weights of the four texels around each pixel."""
    for i in range(len(s)):
        _find_corners_of(i, s, q, level[0, i], level[1, i], level[2, i], place, weight)


@njit(**JIT)
def _find_corners_in_one(s, q, offset, width, height, place, weight):
    """The same for pixels of one level, which is faster: about two thirds of all tiles."""
    for i in range(len(s)):
        _find_corners_of(i, s, q, offset, width, height, place, weight)


@njit(**JIT)
def _find_corners_of(i, s, q, offset, width, height, place, weight):
    zero, half, one = np.float32(0), np.float32(0.5), np.int32(1)
    x = min(max(s[i] * np.float32(width) - half, zero), np.float32(width - one))
    y = min(max(q[i] * np.float32(height) - half, zero), np.float32(height - one))
    xi, yi = np.int32(x * np.float32(256)), np.int32(y * np.float32(256))
    x0, y0 = xi >> np.int32(8), yi >> np.int32(8)
    ix, iy = xi & np.int32(255), yi & np.int32(255)
    both = (ix * iy) >> np.int32(8)
    weight[0, i] = np.uint32(np.int32(256) + both - ix - iy)
    weight[1, i] = np.uint32(ix - both)
    weight[2, i] = np.uint32(iy - both)
    weight[3, i] = np.uint32(both)
    base = offset + y0 * width + x0
    right = np.int32(x0 < width - one)
    down = width if y0 < height - one else np.int32(0)
    place[0, i] = base
    place[1, i] = base + right
    place[2, i] = base + down
    place[3, i] = base + down + right


@njit(**JIT)
def _mix_corners(texel, weight, out):
    """Red and blue in one product, green in another: 255 x 256 fits into the 16 bits of each."""
    for i in range(len(out)):
        rb, g = np.uint32(0), np.uint32(0)
        for c in range(4):
            rb += (texel[c, i] & _RED_BLUE) * weight[c, i]
            g += ((texel[c, i] >> _BITS) & _GREEN) * weight[c, i]
        out[i] = ((rb >> _BITS) & _RED_BLUE) | (g & np.uint32(0xFF00))


@njit(**JIT)
def _mix(texel, weight, share, out):
    """The same, then the two levels by their shares. Two passes would add 3 to 6 % to a picture."""
    for i in range(len(out)):
        coarse, fine = share[i], np.uint32(256) - share[i]
        red_blue, green = np.uint32(0), np.uint32(0)
        for k in range(2):
            rb, g = np.uint32(0), np.uint32(0)
            for c in range(4):
                rb += (texel[k, c, i] & _RED_BLUE) * weight[k, c, i]
                g += ((texel[k, c, i] >> _BITS) & _GREEN) * weight[k, c, i]
            part = coarse if k else fine
            red_blue += ((rb >> _BITS) & _RED_BLUE) * part
            green += (g >> _BITS) * part
        out[i] = ((red_blue >> _BITS) & _RED_BLUE) | (green & np.uint32(0xFF00))
