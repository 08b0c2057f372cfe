"""Selects the keyframes that stay: those that show surface that few others show."""

from typing import NamedTuple

import numpy as np

from hsslam_node.config.mapping import KeyframeConfig
from hsslam_node.geometry.view_distance import surface_shifts_m, view_distance
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.cell_counts import CellCounts
from hsslam_node.mapping.changed_view import ENOUGH_VIEWS, has_changed, recent_views
from hsslam_node.mapping.view_cells import CELL_M, view_cells

_SCARCE = 0.7  # of the capacity: above it fewer keyframes stay
_FULL = 0.95  # of the capacity: above it the fewest stay
_COMPARED = 64  # kept keyframes that are compared to choose one that retires
_AT_A_TIME = 16  # keyframes whose cells are computed in one call, 2 ms each
_MOVED_AT_A_TIME = 8  # the same for keyframes that a correction moved
_ONE_PLACE = 1.0  # m, or radians, between views of one place
_MOST_OF_CHANGE = 2 * ENOUGH_VIEWS  # of one place that stay only for a change: before and after
_NEW_AT_THE_END = 0.02  # a keyframe stays if no other shows a larger share of its cells


class _Counted(NamedTuple):
    """A keyframe that stays."""

    places: np.ndarray  # of its cells
    T_world_cam: np.ndarray  # [4, 4], when they were counted


class KeyframeSelection:
    """Decides, for each keyframe that leaves the ring of recent ones, whether it stays or is retired.

    A keyframe stays if fewer than `views` kept keyframes show each of more than `new_share` of its cells
    (`view_cells`), or if it shows that something was moved (`has_changed`), until six show it. Of the views
    of one place that stay only for this, the oldest retires from twelve on. `views` shrinks as memory gets
    scarce. If memory is full, or if keyframes wait for room (`KeyframeRoom.want`), the most redundant of some
    kept keyframes retire. Keyframe 0, which fixes the world, stays. Keyframes that a correction has moved
    count at their new poses.

    `judges_all`: judge also the keyframes that left the ring before the first call. Otherwise these stay, as
    an earlier selection has judged them.
    """

    def __init__(
        self, config: KeyframeConfig, max_depth_m: float, *, judges_all: bool = False
    ) -> None:
        self._config = config
        self._max_depth_m = max_depth_m
        self._counts = CellCounts()
        self._counted: dict[int, _Counted] = {}
        self._judged = 0 if judges_all else None  # first keyframes, which all stay; None: unknown
        self._of_change: list[int] = []  # keyframes that stay only for a change, the oldest first
        self._moved: list[int] = []  # keyframes that are counted at an old pose
        self._pose_version = 0  # of the store, for `_moved`
        self._next = 0  # index of the next kept keyframe to compare
        self._saved_counts: CellCounts | None = None  # of keyframes of the loaded map, at the end
        self._last_counts = CellCounts()  # of these and of the run's keyframes that stay
        self._next_own = 0  # first keyframe that is not compared with the loaded map

    def select(self, store: KeyframeStore) -> int:
        """Judge the keyframes that have left the ring; returns how many retired.

        A new selection over an existing store counts some keyframes in each call, the oldest first. If too
        many are kept it counts all at once, as only counted keyframes can retire.
        """
        most = store.room.most_kept
        kept = store.kept()
        spare = max(1, min(8, most // 4), store.room.wanted)
        ring = min(self._config.recent, max(2, most // 2))
        older = kept[kept < store.count - ring]
        if self._judged is None:
            self._judged = store.count - ring
        self._follow_corrections(store)
        pending = [int(k) for k in older if k not in self._counted]
        at_once = len(pending) if len(kept) > most - spare else _AT_A_TIME
        retired = 0
        for k in pending[:at_once]:
            counted = self._cells_of(store, k)
            stays = k < max(store.inherited, self._judged, 1)
            if stays or self._is_new(counted.places, len(kept) - retired, most):
                self._count(k, counted)
            elif _shows_change(store, k):
                self._count(k, counted)
                self._of_change.append(k)
                retired += self._retire_superseded(store, k, older)
            else:
                retired += self._retire(store, k, older)
        while len(kept) - retired > most - spare and len(self._counted) > 1:
            self._retire(store, self._most_redundant(), older)
            retired += 1
        return retired

    def select_last(self, store: KeyframeStore) -> int:
        """At the end of a run that continues a saved map, retire keyframes that show what this map shows, but
        the newest; some in each call. Returns how many are not compared with it yet: call it until 0.

        A keyframe stays if more than `new_share` of its cells are in no keyframe of the map, if more than 2 %
        are neither in these nor in one that stays, or if something has been moved there since these and the
        earlier ones that stay (`has_changed`).
        """
        kept, inherited = store.kept(), store.inherited
        saved, own = kept[kept < inherited], kept[kept >= max(inherited, self._next_own)][:-1]
        if len(saved) == 0 or len(own) == 0:
            return 0
        self._follow_corrections(store)
        uncounted = [int(k) for k in saved if k not in self._counted]
        for k in uncounted[:_AT_A_TIME]:
            self._count(k, self._cells_of(store, k))
        if uncounted or self._moved:
            return len(own)
        if self._saved_counts is None:
            self._saved_counts = CellCounts()
            for k in saved:
                self._saved_counts.add(self._counted[int(k)].places, 1)
                self._last_counts.add(self._counted[int(k)].places, 1)
            self._last_counts.add(self._cells_of(store, int(kept[-1])).places, 1)
        earlier = kept[kept < own[0]]
        for k in own[:_AT_A_TIME].tolist():
            self._next_own = k + 1
            places = (self._counted.get(k) or self._cells_of(store, k)).places
            if (
                _unseen(self._saved_counts, places) > self._config.new_share
                or _unseen(self._last_counts, places) > _NEW_AT_THE_END
                or has_changed(store, k, earlier[earlier < k])
            ):
                earlier = np.append(earlier, k)
                self._last_counts.add(places, 1)
            else:
                self._retire(store, k, saved)
        return len(own[_AT_A_TIME:])

    def _follow_corrections(self, store: KeyframeStore) -> None:
        """Count some keyframes again that a correction has moved by more than half a cell."""
        if (version := store.pose_version) != self._pose_version and self._counted:
            ids = np.array(list(self._counted), np.int64)
            then = np.stack([counted.T_world_cam for counted in self._counted.values()])
            shifts_m = surface_shifts_m(then, store.poses_of(ids))
            self._moved = ids[shifts_m > 0.5 * CELL_M].tolist()
        self._pose_version = version
        for k in self._moved[:_MOVED_AT_A_TIME]:
            if k in self._counted:
                self._counts.add(self._counted[k].places, -1)
                self._count(k, self._cells_of(store, k))
        self._moved = self._moved[_MOVED_AT_A_TIME:]

    def _cells_of(self, store: KeyframeStore, k: int) -> _Counted:
        T_world_cam = store.pose(k)
        cells = view_cells(store.frame(k), T_world_cam, self._max_depth_m)
        return _Counted(self._counts.places(cells), T_world_cam)

    def _count(self, k: int, counted: _Counted) -> None:
        self._counted[k] = counted
        self._counts.add(counted.places, 1)

    def _is_new(self, places: np.ndarray, kept: int, most: int) -> bool:
        pressure = (kept / most - _SCARCE) / (_FULL - _SCARCE)
        views = self._config.views * (1.0 - np.clip(pressure, 0.0, 0.9))
        share = np.mean(self._counts.of(places) < views) if places.shape[1] else 0.0
        return bool(share > self._config.new_share)

    def _most_redundant(self) -> int:
        """The keyframe whose cells other keyframes show most, among the next kept ones in turn."""
        ids = [k for k in self._counted if k != 0]
        ids = [ids[(self._next + i) % len(ids)] for i in range(min(_COMPARED, len(ids)))]
        self._next += len(ids)
        shown = [self._counts.of(self._counted[k].places) for k in ids]
        own = [float(np.mean(1.0 / np.maximum(counts, 1))) for counts in shown]
        return ids[int(np.argmin(own))]

    def _retire_superseded(self, store: KeyframeStore, k: int, older: np.ndarray) -> int:
        """Retire the oldest view of what keyframe k shows that stays only for a change, if there are many: at
        a door that opens and closes, newer ones show both. Returns how many retired."""
        self._of_change = [j for j in self._of_change if store.is_kept(j)]
        ids = np.array(self._of_change, np.int64)
        near = ids[view_distance(store.pose(k), store.poses_of(ids)) <= _ONE_PLACE]
        same = recent_views(store, k, near, _MOST_OF_CHANGE + 1)
        return self._retire(store, same[-1], older) if len(same) > _MOST_OF_CHANGE else 0

    def _retire(self, store: KeyframeStore, k: int, older: np.ndarray) -> int:
        """Retire keyframe k, anchored to the nearest that stays; return 1, or 0 if no other stays."""
        counted = self._counted.pop(k, None)
        anchors = np.array([a for a in self._counted if store.is_kept(a)], np.int64)
        if len(anchors) == 0:
            anchors = older[older != k]
        if len(anchors) == 0:
            return 0
        if counted is not None:
            self._counts.add(counted.places, -1)
        away = view_distance(store.pose(k), store.poses_of(anchors))
        store.retire(k, int(anchors[away.argmin()]))
        return 1


def _shows_change(store: KeyframeStore, k: int) -> bool:
    """Whether something has been moved since the keyframes before k that are kept."""
    kept = store.kept()
    earlier = kept[kept < k]
    return len(earlier) > 0 and has_changed(store, k, earlier, kept[kept > k])


def _unseen(counts: CellCounts, places: np.ndarray) -> float:
    """Share of the cells at places [2, n] that no counted keyframe shows; 1 without cells."""
    return float(np.mean(counts.of(places) == 0)) if places.shape[1] else 1.0
