"""Which keyframes stay: those that show something that the others do not."""

from typing import NamedTuple

import numpy as np

from hsslam_node.config.mapping import KeyframeConfig
from hsslam_node.geometry.view_distance import surface_shifts_m, view_distance
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.cell_counts import CellCounts
from hsslam_node.mapping.view_cells import CELL_M, view_cells

_PRESSED = 0.7  # of what may be kept: from there on the bar rises
_FULL = 0.95  # where it has risen to the top
_LOOKED_AT = 64  # kept keyframes that are compared when one has to go
_AT_A_TIME = 16  # keyframes whose cells are computed in one call, 2 ms each
_MOVED_AT_A_TIME = 8  # and of those that were corrected


class _Counted(NamedTuple):
    """A keyframe that stays."""

    places: np.ndarray  # of its cells
    T_world_cam: np.ndarray  # [4, 4], where it stood when they were counted


class KeyframeSelection:
    """Decides, for each keyframe that leaves the ring of recent ones, whether it stays or is retired.

    It stays if more than `new_share` of its cells (`view_cells`) are shown by fewer than `views` kept ones.
    When memory gets scarce fewer views are wanted; when it is full, or when keyframes wait for room
    (`KeyframeStore.want`), the most redundant of some kept ones are retired. Keyframe 0, to which the world
    is fixed, stays. Keyframes that a correction has moved count where they stand now.

    `judges_all`: also the keyframes that have left the ring before the first call; otherwise a selection
    before this one has judged them, and they stay.
    """

    def __init__(
        self, config: KeyframeConfig, max_depth_m: float, *, judges_all: bool = False
    ) -> None:
        self._config = config
        self._max_depth_m = max_depth_m
        self._counts = CellCounts()
        self._counted: dict[int, _Counted] = {}
        self._judged = 0 if judges_all else None  # keyframes that stay; None: not known yet
        self._moved: list[int] = []  # counted where they do not stand any more
        self._pose_version = 0  # for which this is so
        self._next = 0  # place in the round through kept keyframes

    def select(self, store: KeyframeStore) -> int:
        """Look at the keyframes that have left the ring; returns how many retired.

        A new selection over a store that is there counts the oldest first. It counts some in each call, but
        all in one if too many are kept: only what is counted can make room.
        """
        most = store.most_kept
        kept = store.kept()
        spare = max(1, min(8, most // 4), store.wanted)
        ring = min(self._config.recent, max(2, most // 2))
        older = kept[kept < store.count - ring]
        if self._judged is None:
            self._judged = store.count - ring
        self._follow_corrections(store)
        pending = [int(k) for k in older if k not in self._counted]
        at_once = len(pending) if len(kept) > most - spare else _AT_A_TIME
        retired = 0
        for k in pending[:at_once]:
            counted = self._looked_at(store, k)
            stays = k < max(store.inherited, self._judged, 1)
            if stays or self._is_new(counted.places, len(kept) - retired, most):
                self._count(k, counted)
            else:
                retired += self._retire(store, k, older)
        while len(kept) - retired > most - spare and len(self._counted) > 1:
            self._retire(store, self._most_redundant(), older)
            retired += 1
        return retired

    def _follow_corrections(self, store: KeyframeStore) -> None:
        """Count some of the keyframes anew that have moved by more than half a cell."""
        if (version := store.pose_version) != self._pose_version and self._counted:
            ids = np.array(list(self._counted), np.int64)
            then = np.stack([counted.T_world_cam for counted in self._counted.values()])
            shifts_m = surface_shifts_m(then, store.poses_of(ids))
            self._moved = ids[shifts_m > 0.5 * CELL_M].tolist()
        self._pose_version = version
        for k in self._moved[:_MOVED_AT_A_TIME]:
            if k in self._counted:
                self._counts.add(self._counted[k].places, -1)
                self._count(k, self._looked_at(store, k))
        self._moved = self._moved[_MOVED_AT_A_TIME:]

    def _looked_at(self, store: KeyframeStore, k: int) -> _Counted:
        T_world_cam = store.pose(k)
        cells = view_cells(store.frame(k), T_world_cam, self._max_depth_m)
        return _Counted(self._counts.places(cells), T_world_cam)

    def _count(self, k: int, counted: _Counted) -> None:
        self._counted[k] = counted
        self._counts.add(counted.places, 1)

    def _is_new(self, places: np.ndarray, kept: int, most: int) -> bool:
        pressure = (kept / most - _PRESSED) / (_FULL - _PRESSED)
        views = self._config.views * (1.0 - np.clip(pressure, 0.0, 0.9))
        share = np.mean(self._counts.of(places) < views) if places.shape[1] else 0.0
        return bool(share > self._config.new_share)

    def _most_redundant(self) -> int:
        """Of the next kept ones, going round, that of whose cells others show most."""
        ids = [k for k in self._counted if k != 0]
        ids = [ids[(self._next + i) % len(ids)] for i in range(min(_LOOKED_AT, len(ids)))]
        self._next += len(ids)
        shown = [self._counts.of(self._counted[k].places) for k in ids]
        own = [float(np.mean(1.0 / np.maximum(counts, 1))) for counts in shown]
        return ids[int(np.argmin(own))]

    def _retire(self, store: KeyframeStore, k: int, older: np.ndarray) -> int:
        """Retire keyframe k if there is another to hang it on: the nearest of those that stay."""
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
