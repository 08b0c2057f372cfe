"""The load level in the arena, which the tracker writes; apart, as all processes read it (no torch)."""

from pathlib import Path

import numpy as np

from hsslam_services.governor.levels import LEVELS, LoadLevel

_FILE = "load_level"


class SharedLevel:
    """The current load level; 0 until the tracker sets it, and always in lockstep."""

    def __init__(self, arena_dir: Path | str) -> None:
        self._row = np.memmap(Path(arena_dir) / _FILE, np.int64, "r+", shape=(1,))

    @classmethod
    def create(cls, arena_dir: Path | str) -> None:
        """Create it; call this before any other process starts."""
        np.memmap(Path(arena_dir) / _FILE, np.int64, "w+", shape=(1,)).flush()

    @property
    def number(self) -> int:
        """Row of `LEVELS`."""
        return min(max(int(self._row[0]), 0), len(LEVELS) - 1)

    @number.setter
    def number(self, value: int) -> None:
        self._row[0] = value

    @property
    def now(self) -> LoadLevel:
        """The current row of `LEVELS`."""
        return LEVELS[self.number]
