"""The number of keyframes that the run may keep, from its memory budget and the free shared memory."""

import contextlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from hsslam_node.map.store import KeyframeStore
from hsslam_services.arena.shared_pages import held_bytes

_FULL = 0.95  # share of the budget in use; the rest is for arrays that grow slowly, such as poses
_LEFT_FREE = 0.1  # share of the system's shared memory to leave free for zenoh and poses
_FEWEST = 12  # keyframes, even if the budget is smaller
_SCARCE = 0.7  # share of the limit at which the notice is sent
_LOOK_EVERY = 8  # calls between measurements of the arena
_PIXELS = ("keyframe_color.", "keyframe_depth.")  # prefixes of arrays


class _Room(NamedTuple):
    limit: str  # name of the tightest limit
    keyframes: int  # that fit; below 0 if the run exceeds the limit without any
    others_mb: int  # memory of the run without the pixels of keyframes


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
        self._room = _Room("", 0, 0)

    def apply(self, store: KeyframeStore) -> str | None:
        """Set the store's limit by the memory; returns a notice for the user, or None."""
        fewest = min(_FEWEST, store.room.capacity)
        if self._calls % _LOOK_EVERY == 0:
            self._room = self._measured(store)
            store.room.allow(max(self._room.keyframes, fewest))
        self._calls += 1
        limit, room, others_mb = self._room
        if room < fewest and not self._is_short:
            self._is_reported = self._is_short = True
            return (
                f"{limit} is too little: map, poses and zenoh take {others_mb} MB, which leaves room for "
                f"{max(room, 0)} keyframes: the run keeps {fewest} and exceeds the limit, and the mesh loses "
                "what the other keyframes showed"
            )
        kept, most = len(store.kept()), store.room.most_kept
        if self._is_reported or kept < _SCARCE * most:
            return None
        self._is_reported = True
        return (
            f"the run keeps {kept} keyframes; there is room for {most} ({limit}): from now on the "
            "mapper removes redundant keyframes"
        )

    def _measured(self, store: KeyframeStore) -> _Room:
        files = _files(self._folder)
        pixels = held_bytes(file for name, file in files.items() if name.startswith(_PIXELS))
        others = held_bytes(files.values()) - pixels + self._bytes_beside()
        system = os.statvfs(self._folder)
        total, free = (n * system.f_frsize for n in (system.f_blocks, system.f_bavail))
        limits = {
            f"--memory-gb {self._memory_gb:g}": _FULL * 1e9 * self._memory_gb - others,
            f"{self._folder.parent} of {total / 1e6:.0f} MB": pixels + free - _LEFT_FREE * total,
            "keyframes.capacity": store.room.capacity * store.pixel_bytes,
        }
        limit = min(limits, key=limits.__getitem__)
        return _Room(limit, int(limits[limit]) // store.pixel_bytes, round(others / 1e6))


def _files(folder: Path) -> dict[str, os.stat_result]:
    """Files of a folder by name; links are not followed to the disk."""
    files = {}
    with os.scandir(folder) as entries:
        for entry in entries:
            with contextlib.suppress(FileNotFoundError):  # renamed or removed meanwhile
                files[entry.name] = entry.stat(follow_symlinks=False)
    return files
