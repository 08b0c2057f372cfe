"""Numba kernel: which primitives may be seen in which tile of the screen."""

import numpy as np

from hsslam_node.kernels.compiled import njit
from hsslam_node.synth.rendering.texture_lookup import JIT

TILE = 16  # pixels
NEAR_M = 0.02
_MARGIN = 1e-4  # well above the rounding of a depth in float32


@njit(**JIT)
def bin_primitives(rotations, centers, halves, T, intrinsics, height, width):
    """Counts [tiles] and members [tiles, P] of the primitives that may be seen in each tile, nearest
    first; and closest [P] float32: no depth of primitive p is below closest[p].

    Judged by the screen box of the corners, edges clipped at the near plane; primitive 0, the room,
    is in all tiles.
    """
    n = len(centers)
    tiles_x, tiles_y = (width + TILE - 1) // TILE, (height + TILE - 1) // TILE
    counts = np.zeros(tiles_x * tiles_y, np.int32)
    members = np.empty((tiles_x * tiles_y, n), np.int32)
    closest = np.empty(n, np.float32)
    corners = np.empty((8, 3))
    boxes = np.empty((n, 4), np.int32)  # first and last tile across, first and last down
    for p in range(n):
        nearest = 1e9
        for c in range(8):
            corners[c] = 0.0
            for i in range(3):
                w = centers[p, i] - T[i, 3]
                for a in range(3):
                    w += rotations[p, i, a] * halves[p, a] * (1.0 if (c >> a) & 1 else -1.0)
                for b in range(3):
                    corners[c, b] += T[i, b] * w
            nearest = min(nearest, corners[c, 2])
        closest[p] = (1 - _MARGIN) * nearest - _MARGIN
        low_u, high_u, low_v, high_v = 1e9, -1e9, 1e9, -1e9
        for c in range(8):
            for a in range(-1, 3):  # the corner itself, then the three edges that leave it
                d = c if a < 0 else c ^ (1 << a)
                x, y, z = corners[c]
                if z < NEAR_M:
                    if corners[d, 2] < NEAR_M:
                        continue
                    clip = (NEAR_M - z) / (corners[d, 2] - z)
                    x += clip * (corners[d, 0] - x)
                    y += clip * (corners[d, 1] - y)
                    z = NEAR_M
                u = x / z * intrinsics[0] + intrinsics[2]
                v = y / z * intrinsics[1] + intrinsics[3]
                low_u, high_u = min(low_u, u), max(high_u, u)
                low_v, high_v = min(low_v, v), max(high_v, v)
        if p == 0:
            closest[0] = -1e9
            low_u, low_v, high_u, high_v = 0.0, 0.0, float(width), float(height)
        if high_u < 0 or high_v < 0 or low_u > width - 1 or low_v > height - 1:
            boxes[p, 0] = boxes[p, 2] = 0
            boxes[p, 1] = boxes[p, 3] = -1
            continue
        boxes[p, 0], boxes[p, 1] = (
            int(max(low_u, 0)) // TILE,
            int(min(high_u + 1, width - 1)) // TILE,
        )
        boxes[p, 2], boxes[p, 3] = (
            int(max(low_v, 0)) // TILE,
            int(min(high_v + 1, height - 1)) // TILE,
        )
    for p in np.argsort(closest):
        for y in range(boxes[p, 2], boxes[p, 3] + 1):
            for x in range(boxes[p, 0], boxes[p, 1] + 1):
                tile = y * tiles_x + x
                members[tile, counts[tile]] = p
                counts[tile] += 1
    return counts, members, closest
