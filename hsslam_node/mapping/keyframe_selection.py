"""Which keyframes stay: those that show something that the others do not."""

import numpy as np

from hsslam_node.config.mapping import KeyframeConfig
from hsslam_node.geometry.view_distance import view_distance
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.cell_counts import CellCounts
from hsslam_node.mapping.view_cells import view_cells

_PRESSED = 0.7  # of what may be kept: from there on the bar rises
_FULL = 0.95  # where it has risen to the top
_LOOKED_AT = 64  # kept keyframes that are compared when one has to go
_AT_A_TIME = 16  # keyframes whose cells are computed in one call, 2 ms each


class KeyframeSelection:
    """Decides, for each keyframe that leaves the ring of recent ones, whether it stays or is retired.

    It stays if more than `new_share` of its cells (`view_cells`) are shown by fewer than `views` kept ones.
    When memory gets scarce fewer views are wanted; when it is full, or when keyframes wait for room
    (`KeyframeStore.want`), the most redundant of some kept ones are retired. Keyframe 0, to which the world
    is fixed, stays.
    """

    def __init__(self, config: KeyframeConfig, max_depth_m: float) -> None:
        self._config = config
        self._max_depth_m = max_depth_m
        self._counts = CellCounts()
        self._places: dict[int, np.ndarray] = {}  # of the cells of each keyframe that stays
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
        pending = [int(k) for k in older if k not in self._places]
        at_once = len(pending) if len(kept) > most - spare else _AT_A_TIME
        retired = 0
        for k in pending[:at_once]:
            places = self._counts.places(
                view_cells(store.frame(k), store.pose(k), self._max_depth_m)
            )
            if k < max(store.inherited, 1) or self._is_new(places, len(kept) - retired, most):
                self._places[k] = places
                self._counts.add(places, 1)
            else:
                retired += self._retire(store, k, older)
        while len(kept) - retired > most - spare and len(self._places) > 1:
            self._retire(store, self._most_redundant(), older)
            retired += 1
        return retired

    def _is_new(self, places: np.ndarray, kept: int, most: int) -> bool:
        pressure = (kept / most - _PRESSED) / (_FULL - _PRESSED)
        views = self._config.views * (1.0 - np.clip(pressure, 0.0, 0.9))
        share = np.mean(self._counts.of(places) < views) if places.shape[1] else 0.0
        return bool(share > self._config.new_share)

    def _most_redundant(self) -> int:
        """Of the next kept ones, going round, that of whose cells others show most."""
        ids = [k for k in self._places if k != 0]
        ids = [ids[(self._next + i) % len(ids)] for i in range(min(_LOOKED_AT, len(ids)))]
        self._next += len(ids)
        own = [float(np.mean(1.0 / np.maximum(self._counts.of(self._places[k]), 1))) for k in ids]
        return ids[int(np.argmin(own))]

    def _retire(self, store: KeyframeStore, k: int, older: np.ndarray) -> int:
        """Retire keyframe k if there is another to hang it on: the nearest of those that stay."""
        places = self._places.pop(k, None)
        anchors = np.array([a for a in self._places if store.is_kept(a)], np.int64)
        if len(anchors) == 0:
            anchors = older[older != k]
        if len(anchors) == 0:
            return 0
        if places is not None:
            self._counts.add(places, -1)
        away = view_distance(store.pose(k), store.poses_of(anchors))
        store.retire(k, int(anchors[away.argmin()]))
        return 1
