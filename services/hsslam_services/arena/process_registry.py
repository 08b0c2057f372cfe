"""The processes of an arena; apart from the folder, as each process enters itself (no torch)."""

import contextlib
import os
from pathlib import Path

from hsslam_services.arena.arena_folder import start_ticks

_FOLDER = "processes"


def enter_process(arena_dir: Path, name: str) -> None:
    """Enter this process and its name, so that the watchdog of this run finds it.

    Raises:
        OSError: there is no room for the entry.
    """
    with contextlib.suppress(FileNotFoundError):  # the supervisor has removed the arena
        (arena_dir / _FOLDER).mkdir(exist_ok=True)
        (arena_dir / _FOLDER / str(os.getpid())).write_text(f"{start_ticks()} {name}")


def living_processes(arena_dir: Path) -> dict[int, str]:
    """Names of the living processes of the arena, by process id."""
    found = {}
    for entry in (arena_dir / _FOLDER).glob("[0-9]*"):
        with contextlib.suppress(OSError, ValueError, IndexError):
            pid = int(entry.name)
            ticks, name = entry.read_text().split()
            if start_ticks(pid) == int(ticks) and not _is_zombie(pid):
                found[pid] = name
    return found


def _is_zombie(pid: int) -> bool:
    stat = Path(f"/proc/{pid}/stat").read_text()
    return stat.rpartition(")")[2].split()[0] == "Z"
