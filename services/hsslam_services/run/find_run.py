"""Finds running runs on this machine; apart from `arena_folder`, whose importers parse no options."""

import contextlib
from pathlib import Path

from hsslam_node.errors import UserError
from hsslam_services.arena.arena_folder import SHM_ROOT, live_arenas
from hsslam_services.run.run_info import RunInfo


def running_runs(root: Path = SHM_ROOT) -> dict[str, RunInfo | None]:
    """The running runs of this user, oldest first, by run folder, or by arena if the run folder was moved or
    removed. None: the run is of another version, or just starts."""
    runs: dict[str, RunInfo | None] = {}
    for arena in live_arenas(root):
        run = _read(arena)
        place = run.path if run and _read(run.path) == run else arena
        runs[str(place)] = run
    return runs


def _read(folder: Path) -> RunInfo | None:
    with contextlib.suppress(UserError):
        return RunInfo.read(folder)
    return None
