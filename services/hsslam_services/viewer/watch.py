"""Whether a live viewer is there and takes data."""

import time

import rerun as rr

from hsslam_services.bus.publisher import Report
from hsslam_services.viewer.rerun_process import ViewerProcess

_CHECK_S = 2.0
_FIRST_CHECK_S = 20.0  # a viewer may take its time to start


class ViewerWatch:
    """Notices a live viewer that is gone, and tells of one that takes no data, as when it is frozen.

    While it takes none, the queue loses what is old, and what is new is drawn when it comes round.
    """

    def __init__(self, viewer: str, report: Report, process: ViewerProcess | None) -> None:
        self._viewer = viewer
        self._report = report
        self._process = process
        self._next_s = time.monotonic() + _CHECK_S
        self._patience_s = _FIRST_CHECK_S
        self._was_told = False

    def wait_until_it_listens(self) -> None:
        """Then say where its page is; return at once if others started the viewer.

        Not earlier: a viewer that opens the address before there is a server may take the server's port.
        """
        if self._process is None:
            return
        self._process.wait_until_it_listens()
        if self._process.page is not None and not self._process.has_ended():
            self._report("info", f"viewer: open {self._process.page}")

    def is_gone(self, stream: rr.RecordingStream) -> bool:
        """Checked now and then; tells it once."""
        if time.monotonic() < self._next_s:
            return False
        why = self._why_gone(stream)
        self._patience_s = _CHECK_S
        self._next_s = time.monotonic() + _CHECK_S
        if why:
            self._report("warning", f"viewer {self._viewer} {why}; the run goes on without it")
        return bool(why)

    def _why_gone(self, stream: rr.RecordingStream) -> str:
        """Empty: it is there."""
        if self._process is not None and self._process.has_ended():
            return f"is closed (exit code {self._process.exit_code})"
        try:
            stream.flush(timeout_sec=self._patience_s)
            self._was_told = False
        except RuntimeError as error:
            if "timed out" not in str(error):
                return f"is closed ({error})"
            self.takes_nothing()
        return ""

    def takes_nothing(self) -> None:
        """Tell it, once until it takes data again."""
        if not self._was_told:
            self._was_told = True
            self._report("warning", f"viewer {self._viewer} takes no data; the run goes on")
