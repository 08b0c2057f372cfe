"""The options of `hsslam-log`: a frozen dataclass for each command, a field for each option."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

from hsslam_node.errors import UserError
from hsslam_node.export.trajectory_formats import TrajectoryFormat

Part = Literal["trajectory", "mesh", "frames", "rrd"]
PARTS: tuple[Part, ...] = ("trajectory", "mesh", "frames", "rrd")


@dataclass(frozen=True)
class InfoOptions:
    """Shows what logs contain: messages per topic and their rate (Hz), duration (s), the run and its options.

    Example:
      hsslam-log info runs/desk/run.mcap
    """

    POSITIONALS: ClassVar = ("files",)
    VALUES: ClassVar = {"files": "FILE..."}

    files: tuple[str, ...] = ()
    """Logs, or run folders (all parts of the log)."""


@dataclass(frozen=True)
class RecoverOptions:
    """Checks all checksums of a log, and makes it readable if it is unfinished or damaged.

    The command completes an unfinished file in place. It keeps all intact data of a damaged file; the
    original stays as NAME.damaged.mcap beside it.

    Example:
      hsslam-log recover runs/desk/run.mcap
    """

    POSITIONALS: ClassVar = ("file",)
    VALUES: ClassVar = {"file": "FILE"}

    file: str = ""
    """The log, or a run folder (all parts of the log)."""


@dataclass(frozen=True)
class TrimOptions:
    """Copies a part of a log, all topics unchanged.

    It replaces an existing file, but no run.mcap, run.1.mcap, ... of a run.

    Example:
      hsslam-log trim run.mcap short.mcap --start 5 --end 12.5

    Raises:
        UserError: the end is not after the start.
    """

    POSITIONALS: ClassVar = ("log", "out")
    VALUES: ClassVar = {"log": "IN", "out": "OUT"}

    log: str = ""
    """The log, or a run folder (all parts of the log)."""
    out: str = ""
    """File of the new log."""
    start: float = 0.0
    """Start of the copy, s after the earliest message."""
    end: float | None = None
    """End of the copy, s after the earliest message (none: the end of the log)."""

    def __post_init__(self) -> None:
        if not 0 <= self.start < float("inf"):
            raise UserError(f"--start {self.start:g}: expected seconds, 0 or more")
        if self.end is not None and not self.start < self.end:
            raise UserError(f"--end {self.end:g}: expected seconds, more than --start")


@dataclass(frozen=True)
class ExportOptions:
    """Writes the contents of a log as files for other programs.

    Examples:
      hsslam-log export run.mcap --only trajectory mesh
      hsslam-log export run.mcap --only trajectory --format kitti

    Files:
      trajectory_online.txt, .csv     poses as published (TUM: s, m, unit quaternion xyzw, camera to world)
      trajectory.txt, keyframes.txt   refined poses
      trajectory_fragment_1.txt       poses of a fragment that has not joined the map, in its own frame
      mesh.ply, mesh.glb              the mesh; PLY with y down and z forward, glTF with y up
      frames/                         images in TUM layout, for --source tum:FOLDER; second camera: frames-2/
      run.rrd                         a recording for the rerun viewer

    A repeated export replaces these files, and removes those of its parts that the log lacks; it refuses a
    folder that already holds frames.

    Formats of trajectories, all camera to world:
      tum      .txt         s, m, unit quaternion xyzw
      kitti    .kitti.txt   three rows of the 4 x 4 matrix, m; stamps (s) in .kitti.times.txt
      euroc    .euroc.csv   ns, m, unit quaternion wxyz
      csv      .csv         as tum, with commas and a header
    """

    POSITIONALS: ClassVar = ("file",)
    VALUES: ClassVar = {"file": "FILE", "out": "FOLDER"}

    file: str = ""
    """The log, or a run folder (all parts of the log)."""
    out: Path | None = None
    """Output folder (none: FILE-export, FILE without its suffix)."""
    only: tuple[Part, ...] = PARTS
    """Parts to export."""
    format: TrajectoryFormat = "tum"
    """Format of the trajectories."""
