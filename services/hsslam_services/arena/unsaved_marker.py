"""The marker of an arena whose results are not all on disk: which are missing, of which run (no torch)."""

import contextlib
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
    # a watchdog that holds the lock of the arena saves them now; if it dies, the next run saves them
    is_being_saved: bool = False


def mark_unsaved(
    arena_dir: Path, run_dir: Path, artefacts: Iterable[str], *, is_being_saved: bool = False
) -> None:
    """Mark this arena as unsaved: unless it is being saved, only `hsslam-serve rescue` removes it.

    Raises:
        OSError: the arena is gone, or its memory is full.
    """
    unsaved = Unsaved(run_dir, tuple(artefacts), is_being_saved)._asdict()
    partial = arena_dir / f"{_FILE}.partial"
    partial.write_text(json.dumps(unsaved | {"run_dir": str(run_dir)}))
    partial.replace(arena_dir / _FILE)


def leave_to_user(arena_dir: Path, run_dir: Path) -> None:
    """Let an arena wait for `hsslam-serve rescue`, with the artefacts that its mark names, or all; ignores
    errors, as of an arena that is gone or a memory that is full."""
    unsaved = read_unsaved(arena_dir)
    with contextlib.suppress(OSError):
        mark_unsaved(arena_dir, run_dir, unsaved.artefacts if unsaved else ARENA_ARTEFACTS)


def is_marked(arena_dir: Path) -> bool:
    """Whether the arena is marked as unsaved and waits for `hsslam-serve rescue`."""
    return (unsaved := read_unsaved(arena_dir)) is not None and not unsaved.is_being_saved


def read_unsaved(arena_dir: Path) -> Unsaved | None:
    """The missing artefacts; None if the arena is not marked as unsaved."""
    try:
        found = json.loads((arena_dir / _FILE).read_text())
        is_being_saved = bool(found.get("is_being_saved", False))
        return Unsaved(Path(found["run_dir"]), tuple(found["artefacts"]), is_being_saved)
    except (OSError, ValueError, KeyError):
        return None
