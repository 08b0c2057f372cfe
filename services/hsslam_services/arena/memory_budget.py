"""How many keyframes the run may keep: by the budget for shared memory, and by what there is of it."""

import contextlib
import os
from collections.abc import Callable
from pathlib import Path

from hsslam_node.map.store import KeyframeStore
from hsslam_services.arena.shared_pages import held_bytes

_FULL = 0.95  # of the budget; the rest is for what grows slowly, such as poses
_LEFT_FREE = 0.1  # of the shared memory of the system, for zenoh and for poses
_FEWEST = 12  # keyframes, however small the budget
_PRESSED = 0.7  # of what may be kept; told once
_LOOK_EVERY = 8  # calls between looks at the arena
_PIXELS = ("keyframe_color.", "keyframe_depth.")  # names of arrays


class MemoryBudget:
    """Says how many keyframes may be kept, and once that they get scarce.

    The budget is for the memory of all files of the arena, and for `bytes_beside`, which others than the
    arena take for the run. What it leaves is for the pixels of keyframes.
    """

    def __init__(
        self, arena_dir: Path, memory_gb: float, bytes_beside: Callable[[], int] = int
    ) -> None:
        self._folder = arena_dir
        self._memory_gb = memory_gb
        self._bytes_beside = bytes_beside
        self._calls = 0
        self._is_told = False
        self._limit = ""  # what sets it

    def apply(self, store: KeyframeStore) -> str | None:
        """Allow the store as many keyframes as there is memory for; returns what is to be told, if any."""
        if self._calls % _LOOK_EVERY == 0:
            store.allow(self._most(store))
        self._calls += 1
        kept, most = len(store.kept()), store.most_kept
        if self._is_told or kept < _PRESSED * most:
            return None
        self._is_told = True
        return (
            f"the run keeps {kept} keyframes; there is room for {most} ({self._limit}): from now on the "
            "mapper removes keyframes that show little that others do not"
        )

    def _most(self, store: KeyframeStore) -> int:
        files = _files(self._folder)
        pixels = held_bytes(of for name, of in files.items() if name.startswith(_PIXELS))
        others = held_bytes(files.values()) - pixels + self._bytes_beside()
        system = os.statvfs(self._folder)
        total, free = (n * system.f_frsize for n in (system.f_blocks, system.f_bavail))
        limits = {
            f"--memory-gb {self._memory_gb:g}": _FULL * 1e9 * self._memory_gb - others,
            f"{self._folder.parent} of {total / 1e6:.0f} MB": pixels + free - _LEFT_FREE * total,
            "keyframes.capacity": store.capacity * store.pixel_bytes,
        }
        self._limit = min(limits, key=limits.__getitem__)
        return max(int(limits[self._limit]) // store.pixel_bytes, min(_FEWEST, store.capacity))


def _files(folder: Path) -> dict[str, os.stat_result]:
    """By name."""
    files = {}
    with os.scandir(folder) as entries:
        for entry in entries:
            with contextlib.suppress(FileNotFoundError):  # a header that has just got its name
                files[entry.name] = entry.stat(follow_symlinks=False)  # not of what is on the disk
    return files
