"""Moves full arrays to disk, in a thread; apart from the arena, as only the tracker does it."""

import threading
from collections import deque
from collections.abc import Callable
from pathlib import Path
from queue import SimpleQueue
from typing import Literal

from hsslam_services.arena.arena import Arena
from hsslam_services.arena.arena_folder import disk_folder

Report = Callable[[Literal["info", "warning", "error"], str], None]
"""Takes the level and text of an event."""


class FullArrays:
    """Moves arrays of an arena into the run folder, in a thread: a slow disk delays no pose.

    If the disk is full, one warning is sent, and the array stays in shared memory until the next one is full.
    """

    def __init__(self, arena: Arena, run_dir: Path, report: Report) -> None:
        self._arena = arena
        self._folder = disk_folder(run_dir, arena.folder)
        self._report = report
        self._is_reported = False
        self._names: SimpleQueue[str] = SimpleQueue()
        threading.Thread(target=self._move_all, name="full arrays", daemon=True).start()

    def add(self, name: str) -> None:
        """Move this array, which no process writes any more."""
        self._names.put(name)

    def _move_all(self) -> None:
        waiting: deque[str] = deque()
        while True:
            waiting.append(self._names.get())
            while waiting and self._is_moved(waiting[0]):
                waiting.popleft()

    def _is_moved(self, name: str) -> bool:
        try:
            self._arena.move_to_disk(name, self._folder)
        except OSError as error:
            if not self._is_reported:
                self._is_reported = True
                text = f"{self._folder}: {error.strerror}: {name} stays in shared memory for now"
                self._report("warning", text)
            return False
        return True
