"""The number of keyframes that the run may keep, from its memory budget and the free shared memory."""

import contextlib
import os
from collections.abc import Callable
from pathlib import Path

from hsslam_node.map.store import KeyframeStore
from hsslam_services.arena.shared_pages import held_bytes

_FULL = 0.95  # share of the budget in use; the rest is for arrays that grow slowly, such as poses
_LEFT_FREE = 0.1  # share of the system's shared memory to leave free for zenoh and poses
_FEWEST = 12  # keyframes, even if the budget is smaller
_SCARCE = 0.7  # share of the limit at which the notice is sent
_LOOK_EVERY = 8  # calls between measurements of the arena
_PIXELS = ("keyframe_color.", "keyframe_depth.")  # prefixes of arrays


class MemoryBudget:
    """Limits the number of keyframes; sends one notice when the run comes near the limit, and one if the
    limit leaves too little for keyframes.

    The budget covers all files of the arena and `bytes_beside`, the run's memory outside the arena. The
    rest of it is for the pixels of keyframes.
    """

    def __init__(
        self, arena_dir: Path, memory_gb: float, bytes_beside: Callable[[], int] = int
    ) -> None:
        self._folder = arena_dir
        self._memory_gb = memory_gb
        self._bytes_beside = bytes_beside
        self._calls = 0
        self._is_reported = self._is_short = False
        self._limit = ""  # name of the tightest limit
        self._room = 0  # keyframes that fit, may be negative
        self._others_mb = 0  # memory of the run without the pixels of keyframes

    def apply(self, store: KeyframeStore) -> str | None:
        """Set the store's limit by the memory; returns a notice for the user, or None."""
        fewest = min(_FEWEST, store.capacity)
        if self._calls % _LOOK_EVERY == 0:
            self._measure(store)
            store.allow(max(self._room, fewest))
        self._calls += 1
        if self._room < fewest and not self._is_short:
            self._is_reported = self._is_short = True
            return (
                f"{self._limit} is too little: the map and others take {self._others_mb} MB, which leaves "
                f"room for {max(self._room, 0)} keyframes: the run keeps {fewest} and exceeds the limit, and "
                "the mesh loses what the others showed"
            )
        kept, most = len(store.kept()), store.most_kept
        if self._is_reported or kept < _SCARCE * most:
            return None
        self._is_reported = True
        return (
            f"the run keeps {kept} keyframes; there is room for {most} ({self._limit}): from now on the "
            "mapper removes redundant keyframes"
        )

    def _measure(self, store: KeyframeStore) -> None:
        files = _files(self._folder)
        pixels = held_bytes(file for name, file in files.items() if name.startswith(_PIXELS))
        others = held_bytes(files.values()) - pixels + self._bytes_beside()
        system = os.statvfs(self._folder)
        total, free = (n * system.f_frsize for n in (system.f_blocks, system.f_bavail))
        limits = {
            f"--memory-gb {self._memory_gb:g}": _FULL * 1e9 * self._memory_gb - others,
            f"{self._folder.parent} of {total / 1e6:.0f} MB": pixels + free - _LEFT_FREE * total,
            "keyframes.capacity": store.capacity * store.pixel_bytes,
        }
        self._limit = min(limits, key=limits.__getitem__)
        self._room = int(limits[self._limit]) // store.pixel_bytes
        self._others_mb = round(others / 1e6)


def _files(folder: Path) -> dict[str, os.stat_result]:
    """Files of a folder by name; links are not followed to the disk."""
    files = {}
    with os.scandir(folder) as entries:
        for entry in entries:
            with contextlib.suppress(FileNotFoundError):  # renamed or removed meanwhile
                files[entry.name] = entry.stat(follow_symlinks=False)
    return files
