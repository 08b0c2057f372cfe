"""The run that is going on on this machine; apart from `arena_folder`, whose importers parse no options."""

import json
from pathlib import Path

from hsslam_node.errors import UserError
from hsslam_services.arena.arena_folder import SHM_ROOT, live_arenas
from hsslam_services.run.run_info import RunInfo


def running_runs(root: Path = SHM_ROOT) -> list[RunInfo]:
    """What is running here and may be looked at by this user, oldest first."""
    found = []
    for arena in live_arenas(root):
        try:
            owner = json.loads((arena / "owner.json").read_text())
            run = RunInfo.read(Path(owner["run_dir"]))
        except (OSError, ValueError, KeyError, UserError):
            continue  # of another user or version, or not written yet
        if run.arena_dir == str(arena):
            found.append(run)
    return sorted(found, key=lambda run: run.started_ns)
