"""The native viewer that an earlier recorder of the run has opened; apart, as it outlives the recorder."""

from pathlib import Path

import msgspec
import psutil

from hsslam_services.viewer.rerun_process import ViewerProcess

_FILE = ".run.viewer"


class _Note(msgspec.Struct, frozen=True):
    run_id: str
    pid: int
    created_s: float  # of the process: pids are used again
    url: str


class OpenViewer:
    """A note in the run folder of the native viewer that this run has opened."""

    def __init__(self, run_dir: Path, run_id: str) -> None:
        self._path = run_dir / _FILE
        self._run_id = run_id

    def url(self) -> str | None:
        """Address of the viewer that an earlier recorder of this run has opened; None if it is closed."""
        try:
            note = msgspec.json.decode(self._path.read_bytes(), type=_Note)
            process = psutil.Process(note.pid)
            is_same = note.run_id == self._run_id and process.create_time() == note.created_s
            return note.url if is_same and process.status() != psutil.STATUS_ZOMBIE else None
        except (OSError, msgspec.MsgspecError, psutil.Error):
            return None

    def note(self, viewer: ViewerProcess) -> None:
        """Note the viewer for the next recorder; without the file, that one opens another viewer."""
        try:
            created_s = psutil.Process(viewer.pid).create_time()
            note = _Note(self._run_id, viewer.pid, created_s, viewer.url)
            self._path.write_bytes(msgspec.json.encode(note))
        except (OSError, psutil.Error):
            self.forget()

    def forget(self) -> None:
        """Remove the note, at the end of the run."""
        self._path.unlink(missing_ok=True)
