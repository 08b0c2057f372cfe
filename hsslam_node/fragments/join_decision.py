"""Whether a fragment can join the map: places that are apart agree on its pose, and far fewer on another."""

from collections.abc import Sequence

import numpy as np

from hsslam_node.geometry.fragment_place import FragmentPlace
from hsslam_node.merging.meetings import (
    FEWEST_PLACES,
    Meeting,
    agreeing,
    is_clear,
    places_apart,
    second_best,
    show_the_same,
)


def agreed_meetings(meetings: Sequence[Meeting]) -> list[Meeting]:
    """The meetings that agree on the fragment's pose in the map, the one that most agree with first; none if
    the pose is uncertain.

    At least three places that are apart must agree on the pose, and their images must agree in detail. If
    rooms look alike, meetings support several poses: then the answer is none.
    """
    best = agreeing(meetings)
    if places_apart(best) < FEWEST_PLACES or not show_the_same(best):
        return []
    return best if is_clear(best, second_best(meetings, best)) else []


def fragment_place(meetings: Sequence[Meeting]) -> FragmentPlace:
    """By the most central of meetings that agree."""
    T = np.stack([m.T_worlds for m in meetings])  # [n, 4, 4]
    # compared at the cameras, as a small rotation moves the origin of a large fragment far
    at = np.mean([m.T_world_second[:3, 3] for m in meetings], axis=0)
    predicted = T[:, :3, :3] @ at + T[:, :3, 3]  # [n, 3]
    away = np.linalg.norm(predicted - np.median(predicted, axis=0), axis=1)
    k = int(away.argmin())
    return FragmentPlace(T[k], meetings[k].T_world_second[:3, 3])
