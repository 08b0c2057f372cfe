"""Numba kernels: trilinear texture look-up, and the packed colours they work on."""

import numba
import numpy as np

JIT = {"cache": True, "fastmath": True, "nogil": True, "error_model": "numpy"}
_LANES = np.uint64(0x00FF00FF00FF)
_ONE = np.uint64(256)
_WIDEST = np.float32(60)  # texels; every face has the levels for it


@numba.njit(**JIT)
def sample(texels, levels, first, s, q, footprint):
    """Colour 0x00BBGGRR at (s, q) in [0, 1]^2 where a pixel covers `footprint` texels.

    texels [M] uint64: red, green, blue in lanes of 16 bits, so that one product weighs all three.
    levels [N, 3] int32: offset, width, height; `first` is the row of the finest one.
    """
    if footprint <= np.float32(1):
        return pack(_bilinear(texels, levels, first, s, q))
    # log2 from the float's exponent, and a straight line through its mantissa
    bits = np.float32(min(footprint, _WIDEST)).view(np.int32) - np.int32(0x3F800000)
    row = first + (bits >> np.int32(23))
    f = np.uint64((bits >> np.int32(15)) & np.int32(255))
    mixed = _bilinear(texels, levels, row, s, q) * (_ONE - f)
    mixed += _bilinear(texels, levels, row + np.int32(1), s, q) * f
    return pack((mixed >> np.uint64(8)) & _LANES)


@numba.njit(**JIT)
def pack(lanes):
    """Lanes of 16 bits to 0x00BBGGRR."""
    low = (lanes & np.uint64(0xFF)) | ((lanes >> np.uint64(8)) & np.uint64(0xFF00))
    return np.uint32(low | ((lanes >> np.uint64(16)) & np.uint64(0xFF0000)))


@numba.njit(**JIT)
def unpack(c):
    """0x00BBGGRR to lanes of 16 bits."""
    c = np.uint64(c)
    low = (c & np.uint64(0xFF)) | ((c & np.uint64(0xFF00)) << np.uint64(8))
    return low | ((c & np.uint64(0xFF0000)) << np.uint64(16))


@numba.njit(**JIT)
def mix_borders(packed, face_ids, color):
    """Unpacks to RGB [H, W, 3]; at the border of a face a pixel is mixed with its four neighbours.

    A lens does the same: without it the edges of the furniture are stairs.
    """
    height, width = packed.shape
    for v in range(height):
        for u in range(width):
            c = packed[v, u]
            if 0 < v < height - 1 and 0 < u < width - 1:
                f = face_ids[v, u]
                same = (face_ids[v, u + 1] == f) & (face_ids[v, u - 1] == f)
                if not (same & (face_ids[v + 1, u] == f) & (face_ids[v - 1, u] == f)):
                    around = unpack(packed[v, u + 1]) + unpack(packed[v, u - 1])
                    around += unpack(packed[v + 1, u]) + unpack(packed[v - 1, u])
                    around += unpack(c) * np.uint64(4)
                    c = pack((around >> np.uint64(3)) & _LANES)
            color[v, u, 0] = c & np.uint32(0xFF)
            color[v, u, 1] = (c >> np.uint32(8)) & np.uint32(0xFF)
            color[v, u, 2] = (c >> np.uint32(16)) & np.uint32(0xFF)


@numba.njit(**JIT)
def _bilinear(texels, levels, row, s, q):
    row = np.uint64(row)
    offset, width, height = levels[row, 0], levels[row, 1], levels[row, 2]
    zero, half, one = np.float32(0), np.float32(0.5), np.int32(1)
    x = min(max(s * np.float32(width) - half, zero), np.float32(width - one))
    y = min(max(q * np.float32(height) - half, zero), np.float32(height - one))
    xi, yi = np.int32(x * np.float32(256)), np.int32(y * np.float32(256))
    x0, y0 = xi >> np.int32(8), yi >> np.int32(8)
    ix, iy = np.uint64(xi & np.int32(255)), np.uint64(yi & np.int32(255))
    w11 = (ix * iy) >> np.uint64(8)
    w10, w01 = ix - w11, iy - w11
    w00 = _ONE + w11 - ix - iy
    base = np.uint64(offset + y0 * width + x0)
    right = np.uint64(x0 < width - one)
    down = np.uint64(width) if y0 < height - one else np.uint64(0)
    mixed = texels[base] * w00 + texels[base + right] * w10
    mixed += texels[base + down] * w01 + texels[base + down + right] * w11
    return (mixed >> np.uint64(8)) & _LANES
