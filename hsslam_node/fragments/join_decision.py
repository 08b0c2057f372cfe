"""Whether a fragment can join the map: places that are apart agree on its pose, and far fewer on another."""

from collections.abc import Sequence

import numpy as np

from hsslam_node.merging.meetings import Meeting, agreeing, places_apart, show_the_same

_FEWEST_PLACES = 3  # that agree and are apart: two may look alike by chance
_CLEARLY = 3.0  # keyframes that support the best pose over those of the second best, at least


def agreed_meetings(meetings: Sequence[Meeting]) -> list[Meeting]:
    """The meetings that agree on the fragment's pose in the map, the one that most agree with first; none if
    the pose is uncertain.

    At least three places that are apart must agree on the pose, and their images must agree in detail. If
    rooms look alike, meetings support several poses: then the answer is none.
    """
    best = agreeing(meetings)
    if places_apart(best) < _FEWEST_PLACES or not show_the_same(best):
        return []
    chosen = {id(m) for m in best}
    other = agreeing([m for m in meetings if id(m) not in chosen])
    return best if _keyframes(best) >= _CLEARLY * _keyframes(other) else []


def T_map_fragment(meetings: Sequence[Meeting]) -> np.ndarray:
    """[4, 4] by the most central of meetings that agree."""
    T = np.stack([m.T_worlds for m in meetings])  # [n, 4, 4]
    # compared at the cameras, as a small rotation moves the origin of a large fragment far
    at = np.mean([m.T_world_second[:3, 3] for m in meetings], axis=0)
    predicted = T[:, :3, :3] @ at + T[:, :3, 3]  # [n, 3]
    away = np.linalg.norm(predicted - np.median(predicted, axis=0), axis=1)
    return T[int(away.argmin())]


def _keyframes(meetings: Sequence[Meeting]) -> int:
    return len({m.second for m in meetings})
