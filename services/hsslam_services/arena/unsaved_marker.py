"""The marker of an arena whose results are not all on disk: which are missing, of which run (no torch)."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

ARENA_ARTEFACTS = ("trajectories", "map", "mesh")  # in the order of saving
_FILE = "unsaved.json"


class Unsaved(NamedTuple):
    """The artefacts that are missing in a run folder."""

    run_dir: Path
    artefacts: tuple[str, ...]


def mark_unsaved(arena_dir: Path, run_dir: Path, artefacts: Iterable[str]) -> None:
    """Mark this arena as unsaved: only `hsslam-serve rescue` removes it.

    Raises:
        OSError: the arena is gone, or its memory is full.
    """
    partial = arena_dir / f"{_FILE}.partial"
    partial.write_text(json.dumps({"run_dir": str(run_dir), "artefacts": list(artefacts)}))
    partial.replace(arena_dir / _FILE)


def is_marked(arena_dir: Path) -> bool:
    """Whether the arena is marked as unsaved."""
    return (arena_dir / _FILE).exists()


def read_unsaved(arena_dir: Path) -> Unsaved | None:
    """The missing artefacts; None if the arena is not marked as unsaved."""
    try:
        found = json.loads((arena_dir / _FILE).read_text())
        return Unsaved(Path(found["run_dir"]), tuple(found["artefacts"]))
    except (OSError, ValueError, KeyError):
        return None
