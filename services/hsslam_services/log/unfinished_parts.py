"""Finishes the parts of an earlier recorder while the new one records."""

import threading
from pathlib import Path

from hsslam_node.errors import UserError
from hsslam_services.bus.publisher import Report
from hsslam_services.log.file_index import is_finished
from hsslam_services.log.parts import parts
from hsslam_services.log.recovery import recover

_JOIN_S = 5.0


class UnfinishedParts:
    """Finishes unfinished parts in a thread, with one chunk in memory at a time.

    If the run ends earlier, the next command that opens the log finishes them. `report(level, text)`
    takes events.
    """

    def __init__(self, run_dir: Path, report: Report) -> None:
        self._report = report
        self._parts = [path for path in parts(run_dir) if not is_finished(path)]
        self._thread = threading.Thread(target=self._run, name="recovery", daemon=True)
        if self._parts:
            self._thread.start()

    def close(self) -> None:
        """Wait at most 5 s for the thread."""
        if self._parts:
            self._thread.join(_JOIN_S)

    def _run(self) -> None:
        for path in self._parts:
            try:
                self._report("info", f"{path.name}: {recover(path).line()}")
            except FileNotFoundError:  # the oldest part, removed meanwhile
                continue
            except (OSError, UserError) as error:
                self._report("error", f"{path.name}: left unfinished: {error}")
