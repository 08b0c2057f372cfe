"""Whether bodies are free: keyframes saw all of their space, and no surface is in it."""

from collections.abc import Callable

import numpy as np

from hsslam_node.dense_map.shapes import Shapes

_FINEST_M = 0.004  # half side of cubes that are not split further
_BODIES_AT_ONCE = 256
_CUBES_AT_ONCE = 250_000  # in as many bodies, or in one; 0.1 GB
_TO_CORNER = np.sqrt(3)  # of a cube, in half sides
_CHILDREN = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2
Ask = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def are_free(shapes: Shapes, ask: Ask, known_m: float = 0.05) -> np.ndarray:
    """Mask [N] of the bodies whose space keyframes saw everywhere, and in which there is no surface.

    Space up to 1 cm outside a body may count as inside, but never the reverse.

    Args:
        shapes: the bodies.
        ask: for points [M, 3] m, returns distances [M] m to the nearest surface, never too large, and a
            mask [M] of the points that keyframes saw.
        known_m: side of cubes that count as seen if their centre is, m.
    """
    free = np.ones(len(shapes), np.bool_)
    for of in _batches(shapes, known_m):
        _probe(free, of, shapes, ask)
        _look_into(free, of[free[of]], shapes, ask, known_m / 2)
    return free


def _batches(shapes: Shapes, cube_m: float) -> list[np.ndarray]:
    """Numbers of the bodies in each batch; the cubes of a batch of several fit into memory."""
    cubes = (2 * shapes.around()[1] / cube_m) ** 3
    shares = np.clip(cubes / _CUBES_AT_ONCE, 1 / _BODIES_AT_ONCE, 1.0)
    batches = np.floor(np.cumsum(shares) - shares)
    split = np.split(np.arange(len(shapes)), 1 + np.flatnonzero(np.diff(batches)))
    return [of for of in split if len(of)]


def _probe(free: np.ndarray, of: np.ndarray, shapes: Shapes, ask: Ask) -> None:
    """Clear `free` for bodies `of` with a point that was not seen: for long ones `_look_into` is slow."""
    probes = shapes.probes(of)  # [M, P, 3]
    _, known = ask(probes.reshape(-1, 3))
    free[of] = known.reshape(probes.shape[:2]).all(axis=1)


def _look_into(
    free: np.ndarray, of: np.ndarray, shapes: Shapes, ask: Ask, seen_half_m: float
) -> None:
    """Clear `free` for bodies `of` that are not: split cubes around them into eight until decided."""
    centres, half = (part[of] for part in shapes.around())
    half = seen_half_m * 2 ** np.ceil(np.log2(half / seen_half_m))
    while len(of):
        depth_m = shapes.distance_m(centres, of)
        touches = ~(depth_m > _TO_CORNER * half) & free[of]  # or nan
        centres, half, of, depth_m = (part[touches] for part in (centres, half, of, depth_m))
        is_finest = half <= _FINEST_M
        distance_m, known = ask(centres)
        has_surface, is_unknown = ~(distance_m > _TO_CORNER * half), ~known
        is_body = is_finest | ~(depth_m > 0)
        free[of[(has_surface & is_finest) | (is_unknown & is_body)]] = False
        is_open = (has_surface | is_unknown | (half > seen_half_m)) & ~is_finest & free[of]
        centres, half, of = (part[is_open] for part in (centres, half, of))
        children = centres[:, None] + half[:, None, None] * _CHILDREN  # [M, 8, 3]
        centres, half, of = children.reshape(-1, 3), np.repeat(half / 2, 8), np.repeat(of, 8)
