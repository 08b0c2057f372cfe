"""What the recorder tells of the disk, each thing once; apart from the log, which knows no events."""

from pathlib import Path
from typing import Literal

from hsslam_services.bus.publisher import Report
from hsslam_services.log.parted_log import PartedLog


class DiskReport:
    """`tell_of` looks at the log and tells what stops being recorded, and when it goes on."""

    def __init__(self, run_dir: Path, report: Report) -> None:
        self._run_dir = run_dir
        self._report = report
        self._was_short = False
        self._told: set[str] = set()

    def tell_of(self, log: PartedLog) -> None:
        """Call it often; it tells changes only."""
        if log.space_is_short != self._was_short:
            self._was_short = log.space_is_short
            if self._was_short:
                what = "frames, meshes and run.rrd are no longer recorded, all else is"
                self._report("warning", f"{self._run_dir}: disk nearly full: {what}")
            else:
                self._report("info", f"{self._run_dir}: the disk has room: all is recorded again")
        if log.refused:
            self._tell_once("error", f"{self._run_dir}: disk full: nothing more is recorded")
        if log.sync_error:
            self._tell_once("error", f"{log.path}: the disk refuses it: {log.sync_error}")
        if log.removed:
            self._tell_once("info", f"{log.removed[0]}: removed: older than what --log-keep keeps")

    def _tell_once(self, level: Literal["info", "error"], text: str) -> None:
        if text not in self._told:
            self._told.add(text)
            self._report(level, text)
