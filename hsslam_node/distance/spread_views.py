"""Which keyframes a window is marked from if it has too many; apart from it, as this needs poses alone."""

import numpy as np

_AHEAD_M = 2.0  # two views differ if their cameras or the points this far ahead are apart
_ALIKE_M = 0.5  # of two views that differ by less, the newer one is chosen


def spread_views(T_world_cam: np.ndarray, count: int, newest: int) -> np.ndarray:
    """Rows [n] in rising order of up to `count` views: the last `newest`, and of the others those that are
    farthest from the ones chosen before, or the newest views like these.

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
    chosen = set(range(total - max(newest, 1), total))
    apart_m = np.full(total, np.inf)  # to the nearest that is chosen
    for row in chosen:
        apart_m = np.minimum(apart_m, np.linalg.norm(places - places[row], axis=1))
    while len(chosen) < count and apart_m.max() > 0:
        farthest = int(np.argmax(apart_m))
        alike = np.linalg.norm(places - places[farthest], axis=1) < _ALIKE_M
        row = int(np.flatnonzero(alike)[-1])  # what the newest view of a place shows is so
        chosen.add(row)
        apart_m = np.minimum(apart_m, np.linalg.norm(places - places[row], axis=1))
        apart_m[farthest] = 0.0
    return np.array(sorted(chosen))
