"""Whether the run may change its map, where every process can look it up at once (no torch)."""

from pathlib import Path

import numpy as np

_FILE = "run_mode"
_LOCALISE_ONLY = 0  # field


class RunMode:
    """One row of numbers in the arena folder; the supervisor writes, the others look."""

    def __init__(self, arena_dir: Path | str) -> None:
        self._row = np.memmap(Path(arena_dir) / _FILE, np.int64, "r+", shape=(8,))

    @classmethod
    def create(cls, arena_dir: Path | str, *, localise_only: bool) -> "RunMode":
        """Before any other process starts."""
        np.memmap(Path(arena_dir) / _FILE, np.int64, "w+", shape=(8,)).flush()
        mode = cls(arena_dir)
        mode.localise_only = localise_only
        return mode

    @property
    def localise_only(self) -> bool:
        """Keyframes, their poses and the parameters stay as they are."""
        return bool(self._row[_LOCALISE_ONLY])

    @localise_only.setter
    def localise_only(self, value: bool) -> None:
        self._row[_LOCALISE_ONLY] = value
