"""Chooses keyframes that look at different places, for a window that cannot be marked from all of them."""

import numpy as np

_AHEAD_M = 2.0  # two views differ if their cameras or the points this far ahead are apart


def spread_views(T_world_cam: np.ndarray, count: int, newest: int) -> np.ndarray:
    """Rows [n] in rising order of up to `count` views: the last `newest`, and of the others those that are
    farthest from the ones chosen before.

    Args:
        T_world_cam: [N, 4, 4], in the order in which they came.
        count: of rows, at least `newest`.
        newest: of the last rows, which are chosen in any case.
    """
    total = len(T_world_cam)
    if total <= count:
        return np.arange(total)
    centre = T_world_cam[:, :3, 3]
    places = np.hstack([centre, centre + _AHEAD_M * T_world_cam[:, :3, 2]])  # [N, 6] m
    chosen = list(range(total - max(newest, 1), total))
    apart = np.full(total, np.inf)  # squared distance to the nearest that is chosen
    for row in chosen:
        apart = np.minimum(apart, ((places - places[row]) ** 2).sum(axis=1))
    while len(chosen) < count:
        row = int(np.argmax(apart))
        chosen.append(row)
        apart = np.minimum(apart, ((places - places[row]) ** 2).sum(axis=1))
    return np.unique(chosen)
