"""Whether a fragment has met the map: enough places agree on how the two lie, and none disagrees."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hsslam_node.merging.meetings import Meeting, agreeing, places_apart
from hsslam_node.place_recognition.picture_agreement import PictureAgreement

_FEWEST_PLACES = 3  # that agree and are apart: two may look alike by chance
_CLEARLY = (
    3.0  # keyframes that support the best pose, divided by those of the second best, at least
)
_FEWEST_BLOCKS = 60  # of all meetings' images that show something
_ALIKE = 0.85  # of these blocks: 0.95 to 0.98 of one room, 0.67 to 0.72 of rooms that look alike


@dataclass(frozen=True)
class CheckedMeeting(Meeting):
    """A meeting, and how far its two images agree in detail."""

    pictures: PictureAgreement


def agreed_meetings(meetings: Sequence[CheckedMeeting]) -> list[CheckedMeeting]:
    """The meetings that agree on where the fragment lies, the one that most agree with first; none if they
    leave a doubt.

    At least three places that are apart must agree on a pose of the fragment, and their images must agree in
    detail. If rooms look alike, meetings support several poses: then the answer is none.
    """
    best = agreeing(meetings)
    if places_apart(best) < _FEWEST_PLACES or not _show_the_same(best):
        return []
    chosen = {id(m) for m in best}
    other = agreeing([m for m in meetings if id(m) not in chosen])
    return best if _keyframes(best) >= _CLEARLY * _keyframes(other) else []


def T_map_fragment(meetings: Sequence[Meeting]) -> np.ndarray:
    """[4, 4] of meetings that agree: that of the one in the middle of them all."""
    T = np.stack([m.T_worlds for m in meetings])  # [n, 4, 4]
    # of cameras, as a small turn moves the origin of a large fragment far
    at = np.mean([m.T_world_second[:3, 3] for m in meetings], axis=0)
    told = T[:, :3, :3] @ at + T[:, :3, 3]  # [n, 3]
    away = np.linalg.norm(told - np.median(told, axis=0), axis=1)
    return T[int(away.argmin())]


def _show_the_same(meetings: Sequence[CheckedMeeting]) -> bool:
    compared = sum(m.pictures.compared for m in meetings)
    alike = sum(m.pictures.alike for m in meetings)
    return compared >= _FEWEST_BLOCKS and alike >= _ALIKE * compared


def _keyframes(meetings: Sequence[Meeting]) -> int:
    return len({m.second for m in meetings})
