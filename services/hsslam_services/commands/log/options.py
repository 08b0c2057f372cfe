"""What a user can ask of `hsslam-log`: one frozen dataclass a command; every field is an option."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from hsslam_node.errors import UserError

Part = Literal["trajectory", "mesh", "frames", "rrd"]
PARTS: tuple[Part, ...] = ("trajectory", "mesh", "frames", "rrd")


@dataclass(frozen=True)
class InfoOptions:
    """What is in logs: messages of each topic and their rate while it was there (Hz), duration (s), the run
    and its options.

    $ hsslam-log info runs/desk/run.mcap
    """

    files: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FILE...")] = ()
    """Logs, or run folders with all their parts."""


@dataclass(frozen=True)
class RecoverOptions:
    """Makes an unfinished log (of a run that was killed) readable again, in place.

    $ hsslam-log recover runs/desk/run.mcap
    """

    file: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")] = ""
    """The log, or a run folder with all its parts."""


@dataclass(frozen=True)
class TrimOptions:
    """Copies a stretch of a log, all topics as they are.

    $ hsslam-log trim run.mcap short.mcap --start 5 --end 12.5

    Raises:
        UserError: the times leave nothing.
    """

    log: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="IN")] = ""
    """The log, or a run folder with all its parts."""
    out: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="OUT")] = ""
    """The new log."""
    start: float = 0.0
    """Seconds after the first message, from which on messages are copied."""
    end: float | None = None
    """Seconds after the first message, up to which messages are copied (none: to the end)."""

    def __post_init__(self) -> None:
        if not 0 <= self.start < float("inf"):
            raise UserError(f"--start {self.start:g}: expected seconds, 0 or more")
        if self.end is not None and not self.start < self.end:
            raise UserError(f"--end {self.end:g}: expected seconds, more than --start")


@dataclass(frozen=True)
class ExportOptions:
    """Writes what a log holds as files that other programs read.

    $ hsslam-log export run.mcap --only trajectory mesh

    trajectory_online.txt (TUM: s, m, unit quaternion xyzw, camera to world) and trajectory_online.csv: as
    published; trajectory.txt and keyframes.txt: as refined later; mesh.ply (world as ours: y down, z forward)
    and mesh.glb (y up, as glTF wants it); frames/ in TUM layout, which --source tum:FOLDER opens; run.rrd
    for the rerun viewer.
    """

    file: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")] = ""
    """The log, or a run folder with all its parts."""
    out: Path | None = None
    """Folder of the files (none: FILE without its suffix, and -export)."""
    only: tuple[Part, ...] = PARTS
    """Which of trajectory, mesh, frames and rrd."""
