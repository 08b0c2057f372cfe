"""Searches for a fragment's place in the map: a thread compares its keyframes with the map's one by one."""

from concurrent.futures import Future

import numpy as np

from hsslam_node.fragments.fragment import Fragment
from hsslam_node.fragments.join_decision import agreed_meetings, fragment_place
from hsslam_node.geometry.fragment_place import FragmentPlace
from hsslam_node.geometry.projection import world_points
from hsslam_node.map.store import KeyframeStore
from hsslam_node.merging.meetings import Meeting
from hsslam_node.tracking.places.relocalisation import Relocalisation, SeenAgain

_FRAMES = 8  # for a comparison, 120 ms of one core; it ends at the same frame in every run
_MOST_MEETINGS = 300  # the newest
_STRIDE_PX = 16


class JoinSearch:
    """Collects meetings of a fragment with the map, until they give the fragment's place."""

    def __init__(self, store: KeyframeStore, places: Relocalisation, fragment: Fragment) -> None:
        self._store = store
        self._places = places
        self._fragment = fragment
        self._meetings: list[Meeting] = []
        self._compared = -1  # the newest keyframe whose comparison has begun
        self._pending: tuple[int, Future[list[SeenAgain]]] | None = None
        self._frames = 0  # since then
        # computed from all meetings so far; a new meeting may change it
        self._place: FragmentPlace | None = None

    def step(self) -> FragmentPlace | None:
        """Take a frame tracked in the fragment; returns the fragment's place if it is known now."""
        self._frames += 1
        if self._place is not None or self._frames < _FRAMES:
            return self._place
        found = self.collect()
        newest = self._fragment.store.count - 1
        if found is None and newest > self._compared:
            self._compared, self._frames = newest, 0
            frame = self._fragment.store.frame(newest)
            self._pending = newest, self._places.compare(frame)
        return found

    def collect(self) -> FragmentPlace | None:
        """Wait for the comparison that has begun, if any; returns the fragment's place if it is known now."""
        if self._pending is not None:
            k, compared = self._pending
            self._pending = None
            self._take(k, compared.result())
        return self._place

    def _take(self, k: int, found: list[SeenAgain]) -> None:
        """Take what the map shows of keyframe k of the fragment."""
        fragment = self._fragment.store
        if not found or not fragment.is_kept(k):
            return
        self._meetings += [meeting_of(self._store, fragment, k, seen) for seen in found]
        self._meetings = self._meetings[-_MOST_MEETINGS:]
        agreed = agreed_meetings(self._meetings)
        self._place = fragment_place(agreed) if agreed else None


def meeting_of(store: KeyframeStore, fragment: KeyframeStore, k: int, seen: SeenAgain) -> Meeting:
    """The meeting that a comparison of keyframe k of the fragment with the map's `store` has found."""
    match, frame, T = seen.match, fragment.frame(k), fragment.pose(k)
    shown = np.median(world_points(frame.depth_m(), frame.camera, T, _STRIDE_PX), axis=0)
    return Meeting(
        match.keyframe, k, match.T_keyframe_cam, store.pose(match.keyframe), T, shown, seen.pictures
    )
