"""Meetings: keyframes of two maps that show the same place, and which of these matches agree."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from hsslam_node.config import TrackerConfig
from hsslam_node.frame import Frame
from hsslam_node.geometry.projection import world_points
from hsslam_node.geometry.se3 import inverse, so3_log
from hsslam_node.map.store import KeyframeStore
from hsslam_node.place_recognition.keyframe_index import KeyframeIndex
from hsslam_node.place_recognition.picture_agreement import PictureAgreement, picture_agreement
from hsslam_node.tracking.find_loop import find_loop

_CANDIDATES = 3  # keyframes of the first map compared with one of the second, about 35 ms each
_AGREE_M, _DRIFT = 0.1, 0.03  # meetings at a distance d agree within first + second d, m
_AGREE_RAD = 0.05
_APART_M = 1.0  # between `shown` of two places
_ELSEWHERE_M, _ELSEWHERE_RAD = 1.0, 0.35
FEWEST_PLACES = 3  # that agree and are apart: two may look alike by chance
CLEARLY = 3  # keyframes that support the best pose over those of the second best, at least
FEWEST_BLOCKS = 60  # blocks with texture in the images of all meetings
_STRIDE_PX = 16


@dataclass(frozen=True)
class Meeting:
    """A keyframe of the second map that shows what a keyframe of the first shows."""

    first: int  # id in the store of the first map
    second: int  # number in the second map
    T_first_second: np.ndarray  # [4, 4], by dense alignment of the two
    T_world_first: np.ndarray  # [4, 4], world of the first map
    T_world_second: np.ndarray  # [4, 4], world of the second map
    shown: np.ndarray  # [3] m, world of the second map: median of its keyframe's points
    pictures: PictureAgreement  # how far the two images agree in detail

    @property
    def T_worlds(self) -> np.ndarray:
        """[4, 4], from the second world to the first, by this meeting."""
        return self.T_world_first @ self.T_first_second @ inverse(self.T_world_second)


def find_meetings(
    store: KeyframeStore,
    frames: Iterable[Frame],
    T_world_second: np.ndarray,
    config: TrackerConfig,
    seed: int = 0,
) -> list[Meeting]:
    """Compare each keyframe of the second map (`frames`, at poses [n, 4, 4]) with those of the store that
    share most features with it. Matching uses no poses."""
    index = KeyframeIndex(store)
    index.update()
    meetings = []
    for k, (frame, T) in enumerate(zip(frames, T_world_second, strict=True)):
        found = find_loop(store, index, frame, config, candidates=_CANDIDATES, seed=seed)
        if not found:
            continue
        points = world_points(frame.depth_m(), frame.camera, T, _STRIDE_PX)
        shown = np.median(points, axis=0)
        for m in found:
            seen = picture_agreement(store.frame(m.keyframe), frame, m.T_keyframe_cam)
            T_first = store.pose(m.keyframe)
            meetings.append(Meeting(m.keyframe, k, m.T_keyframe_cam, T_first, T, shown, seen))
    return meetings


def agreeing(meetings: Sequence[Meeting]) -> list[Meeting]:
    """The largest set that agrees with one of its meetings on the pose between the worlds; this one is first.

    Two meetings agree if one predicts the camera pose of the other, to 10 cm plus 3 % of the distance
    between them, as maps drift, and to 0.05 rad.
    """
    if not meetings:
        return []
    T_first = np.stack([m.T_world_first @ m.T_first_second for m in meetings])  # [n, 4, 4]
    T_second = np.stack([m.T_world_second for m in meetings])
    best = np.zeros(0, np.int64)
    for k, meeting in enumerate(meetings):
        predicted = meeting.T_worlds @ T_second
        off_m = np.linalg.norm(predicted[:, :3, 3] - T_first[:, :3, 3], axis=1)
        way_m = np.linalg.norm(T_first[:, :3, 3] - T_first[k, :3, 3], axis=1)
        cosine = (np.einsum("nij,nij->n", predicted[:, :3, :3], T_first[:, :3, :3]) - 1.0) / 2.0
        off_rad = np.arccos(np.clip(cosine, -1.0, 1.0))
        agree = np.flatnonzero((off_m < _AGREE_M + _DRIFT * way_m) & (off_rad < _AGREE_RAD))
        if len(agree) > len(best):
            best = np.array([k, *agree[agree != k]])
    return [meetings[k] for k in best.tolist()]


def second_best(meetings: Sequence[Meeting], best: Sequence[Meeting]) -> list[Meeting]:
    """The largest set that agrees on another pose than `best`, the answer of `agreeing`."""
    chosen = {id(meeting) for meeting in best}
    return agreeing([meeting for meeting in meetings if id(meeting) not in chosen])


def elsewhere(meetings: Iterable[Meeting], T_worlds: np.ndarray) -> list[Meeting]:
    """Meetings that contradict T_worlds [4, 4], from the second world to the first: they move the point that
    they show by 1 m or more, or turn it by 20 degrees or more. Drift alone does less."""
    away = []
    for meeting in meetings:
        T_change = inverse(T_worlds) @ meeting.T_worlds
        moved_m = np.linalg.norm((T_change @ np.append(meeting.shown, 1.0))[:3] - meeting.shown)
        turned_rad = np.linalg.norm(so3_log(T_change[:3, :3]))
        if moved_m >= _ELSEWHERE_M or turned_rad >= _ELSEWHERE_RAD:
            away.append(meeting)
    return away


def keyframes_in(meetings: Iterable[Meeting]) -> int:
    """Number of keyframes of the second map in these meetings."""
    return len({meeting.second for meeting in meetings})


def is_clear(best: Sequence[Meeting], second: Sequence[Meeting]) -> bool:
    """Whether far more keyframes support the best pose than the second best; rooms that look alike support
    several poses."""
    return keyframes_in(best) >= CLEARLY * keyframes_in(second)


def places_apart(meetings: Iterable[Meeting]) -> int:
    """Number of places: a meeting is a new one if it is 1 m or more from all places before it."""
    places: list[np.ndarray] = []
    for meeting in meetings:
        if all(np.linalg.norm(meeting.shown - place) >= _APART_M for place in places):
            places.append(meeting.shown)
    return len(places)


def pictures_of(meetings: Iterable[Meeting]) -> PictureAgreement:
    """How far the images of all these meetings agree in detail."""
    found = [m.pictures for m in meetings]
    return PictureAgreement(sum(p.alike for p in found), sum(p.compared for p in found))


def show_the_same(meetings: Iterable[Meeting]) -> bool:
    """Whether the images agree in detail; those of rooms that only have the same furniture do not."""
    pictures = pictures_of(meetings)
    return pictures.compared >= FEWEST_BLOCKS and pictures.are_alike
