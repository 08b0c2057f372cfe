"""Numba kernel: unpacks colours into an image and softens the borders of faces."""

import numpy as np

from hsslam_node.kernels.compiled import njit
from hsslam_node.kernels.copy_rows import copy_row
from hsslam_node.synth.rendering.texture_lookup import JIT

_BYTE, _RED_BLUE = np.uint32(0xFF), np.uint32(0x00FF00FF)
_TO_GREEN, _TO_BLUE = np.uint32(8), np.uint32(16)
_FOURFOLD, _EIGHTH = np.uint32(2), np.uint32(3)


@njit(**JIT)
def mix_borders(packed, face_ids, color):
    """Unpacks 0x00BBGGRR to RGB [H, W, 3]; at the border of a face a pixel is mixed with its four
    neighbours.

    A lens does the same: without it, edges of the furniture are jagged.
    """
    height, width = packed.shape
    row = np.empty(width, np.uint32)
    for v in range(height):
        copy_row(packed[v], row)
        if 0 < v < height - 1:
            _mix_row(packed[v - 1], packed[v], packed[v + 1],
                     face_ids[v - 1], face_ids[v], face_ids[v + 1], row)  # fmt: skip
        for u in range(width):
            color[v, u, 0] = row[u] & _BYTE
            color[v, u, 1] = (row[u] >> _TO_GREEN) & _BYTE
            color[v, u, 2] = (row[u] >> _TO_BLUE) & _BYTE


@njit(**JIT)
def _mix_row(above, here, below, faces_above, faces, faces_below, row):
    """Half the pixel, half its neighbours, if one of them shows another face; no branches."""
    for u in range(1, len(row) - 1):
        f, c = faces[u], here[u]
        left, right, up, down = here[u - 1], here[u + 1], above[u], below[u]
        alone = (faces[u - 1] == f) & (faces[u + 1] == f)
        alone = alone & (faces_above[u] == f) & (faces_below[u] == f)
        rb = (left & _RED_BLUE) + (right & _RED_BLUE) + (up & _RED_BLUE) + (down & _RED_BLUE)
        rb = ((rb + ((c & _RED_BLUE) << _FOURFOLD)) >> _EIGHTH) & _RED_BLUE
        g = ((left >> _TO_GREEN) & _BYTE) + ((right >> _TO_GREEN) & _BYTE)
        g += ((up >> _TO_GREEN) & _BYTE) + ((down >> _TO_GREEN) & _BYTE)
        g = ((g + (((c >> _TO_GREEN) & _BYTE) << _FOURFOLD)) >> _EIGHTH) & _BYTE
        row[u] = c if alone else rb | (g << _TO_GREEN)
