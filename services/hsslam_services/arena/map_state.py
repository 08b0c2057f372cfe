"""The map epoch of the run, and whether the map may change; each process can read it (no torch)."""

from pathlib import Path

import numpy as np

from hsslam_node.map.memory_order import load_ordered, store_ordered

_FILE = "map_state"
_LOCALISE_ONLY, _MAP_EPOCH, _IS_GIVEN_UP, _STOPPED_NS, _SAVED_IN_NS = range(5)  # fields


class MapState:
    """One row of numbers in the arena folder; the supervisor writes it, the other processes read it."""

    def __init__(self, arena_dir: Path | str) -> None:
        self._row = np.memmap(Path(arena_dir) / _FILE, np.int64, "r+", shape=(8,))

    @classmethod
    def create(cls, arena_dir: Path | str, *, localise_only: bool) -> "MapState":
        """Create the row; call it before any other process starts."""
        np.memmap(Path(arena_dir) / _FILE, np.int64, "w+", shape=(8,)).flush()
        mode = cls(arena_dir)
        mode.localise_only = localise_only
        return mode

    @property
    def localise_only(self) -> bool:
        """Whether keyframes, their poses and the parameters are frozen."""
        return bool(load_ordered(self._row, _LOCALISE_ONLY))

    @localise_only.setter
    def localise_only(self, value: bool) -> None:
        store_ordered(self._row, _LOCALISE_ONLY, value)

    @property
    def map_epoch(self) -> int:
        """Number of resets of the map so far."""
        return load_ordered(self._row, _MAP_EPOCH)

    @map_epoch.setter
    def map_epoch(self, value: int) -> None:
        store_ordered(self._row, _MAP_EPOCH, value)

    @property
    def is_given_up(self) -> bool:
        """Whether a reset of the map is about to come; processes do no more work for it."""
        return bool(load_ordered(self._row, _IS_GIVEN_UP))

    @is_given_up.setter
    def is_given_up(self, value: bool) -> None:
        store_ordered(self._row, _IS_GIVEN_UP, value)

    @property
    def stopped_ns(self) -> int:
        """Monotonic time of the stop signal or of the end of the source; 0: the run goes on."""
        return int(self._row[_STOPPED_NS])

    @stopped_ns.setter
    def stopped_ns(self, value: int) -> None:
        self._row[_STOPPED_NS] = value

    @property
    def saved_in_ns(self) -> int:
        """Time from the stop to the first saved map; 0: not saved yet."""
        return int(self._row[_SAVED_IN_NS])

    @saved_in_ns.setter
    def saved_in_ns(self, value: int) -> None:
        self._row[_SAVED_IN_NS] = value

    @property
    def may_change(self) -> bool:
        """Whether keyframe poses and parameters may change now."""
        return not (self.localise_only or self.is_given_up)
