"""The load level, a word of its own in the arena: the tracker writes it, all others look (no torch)."""

from pathlib import Path

import numpy as np

from hsslam_services.governor.levels import LEVELS, LoadLevel

_FILE = "load_level"


class SharedLevel:
    """The level of now; 0 until the tracker sets it, and always in lockstep."""

    def __init__(self, arena_dir: Path | str) -> None:
        self._row = np.memmap(Path(arena_dir) / _FILE, np.int64, "r+", shape=(1,))

    @classmethod
    def create(cls, arena_dir: Path | str) -> None:
        """Before any other process starts."""
        np.memmap(Path(arena_dir) / _FILE, np.int64, "w+", shape=(1,)).flush()

    @property
    def number(self) -> int:
        """Of the row of `LEVELS`."""
        return min(max(int(self._row[0]), 0), len(LEVELS) - 1)

    @number.setter
    def number(self, value: int) -> None:
        self._row[0] = value

    @property
    def now(self) -> LoadLevel:
        """What the processes do."""
        return LEVELS[self.number]
