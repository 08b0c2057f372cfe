"""Events of the recorder about the disk, each sent once; apart from the log, which knows no events."""

from pathlib import Path
from typing import Literal

from hsslam_services.bus.publisher import Report
from hsslam_services.log.parted_log import PartedLog


class DiskReport:
    """Reports when a full disk stops the recording, and when the recording goes on."""

    def __init__(self, run_dir: Path, report: Report) -> None:
        self._run_dir = run_dir
        self._report = report
        self._was_short = False
        self._reported: set[str] = set()

    def tell_of(self, log: PartedLog) -> None:
        """Report changes of the log's state; call this often."""
        if log.space_is_short != self._was_short:
            self._was_short = log.space_is_short
            if self._was_short:
                what = "frames, meshes and run.rrd are no longer recorded, other topics are"
                self._report("warning", f"{self._run_dir}: disk nearly full: {what}")
            else:
                self._report("info", f"{self._run_dir}: disk has room: all topics are recorded")
        if log.refused:
            self._report_once("error", f"{self._run_dir}: disk full: nothing more is recorded")
        if log.sync_error:
            self._report_once("error", f"{self._run_dir}: cannot write to disk: {log.sync_error}")
        if log.removed:
            self._report_once("info", f"{log.removed[0]}: removed: the log exceeds --log-keep")

    def _report_once(self, level: Literal["info", "error"], text: str) -> None:
        if text not in self._reported:
            self._reported.add(text)
            self._report(level, text)
