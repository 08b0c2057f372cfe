"""Whether bodies fit: all of their space was seen, and holds no surface."""

from collections.abc import Callable

import numpy as np

from hsslam_node.dense_map.seen_space import SeenCells
from hsslam_node.dense_map.shapes import Shapes

_FINEST_M = 0.004  # half side of cubes that are not cut further
_AT_ONCE = 256  # bodies
_TO_CORNER = np.sqrt(3)  # of a cube, in half sides
_CHILDREN = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2
DistanceAt = Callable[[np.ndarray], np.ndarray]


def are_free(shapes: Shapes, distance_m: DistanceAt, seen: SeenCells) -> np.ndarray:
    """Mask [N] of the bodies whose space keyframes saw everywhere, and in which there is no surface.

    What lies 1 cm outside a body may count as within; the other way round never.

    Args:
        shapes: the bodies.
        distance_m: gives the distance [M] to the nearest surface at points [M, 3], m; never too large.
        seen: what keyframes saw.
    """
    free = np.ones(len(shapes), np.bool_)
    for first in range(0, len(shapes), _AT_ONCE):
        of = np.arange(first, min(first + _AT_ONCE, len(shapes)))
        _look_into(free, of, shapes, distance_m, seen)
    return free


def _look_into(
    free: np.ndarray, of: np.ndarray, shapes: Shapes, distance_m: DistanceAt, seen: SeenCells
) -> None:
    """Clear `free` for bodies `of`: cut cubes around them into eight until each says yes or no."""
    centres, half = (part[of] for part in shapes.around())
    seen_half_m = seen.grid.voxel_m / 2
    half = seen_half_m * 2 ** np.ceil(np.log2(half / seen_half_m))
    while len(of):
        depth_m = shapes.distance_m(centres, of)
        touches = (depth_m <= _TO_CORNER * half) & free[of]
        centres, half, of, depth_m = (part[touches] for part in (centres, half, of, depth_m))
        is_finest = half <= _FINEST_M
        has_surface = distance_m(centres) <= _TO_CORNER * half
        is_unknown = ~seen.known(centres)
        is_body = is_finest | (depth_m <= 0)
        free[of[(has_surface & is_finest) | (is_unknown & is_body)]] = False
        is_open = (has_surface | is_unknown | (half > seen_half_m)) & ~is_finest & free[of]
        centres, half, of = (part[is_open] for part in (centres, half, of))
        children = centres[:, None] + half[:, None, None] * _CHILDREN  # [M, 8, 3]
        centres, half, of = children.reshape(-1, 3), np.repeat(half / 2, 8), np.repeat(of, 8)
