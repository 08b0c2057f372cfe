"""Watches whether a live viewer runs and takes data."""

import time
from collections.abc import Callable

import rerun as rr

from hsslam_services.bus.publisher import Report
from hsslam_services.viewer.rerun_process import ViewerProcess

_CHECK_S = 2.0
_FIRST_CHECK_S = 20.0  # a viewer may take its time to start


class ViewerWatch:
    """Reports a live viewer that has closed, or that takes no data because it hangs.

    While the viewer takes no data, the queue drops old messages; drawing continues when it responds again.
    """

    def __init__(self, viewer: str, report: Report, process: ViewerProcess | None) -> None:
        self._viewer = viewer
        self._report = report
        self._process = process
        self._next_s = time.monotonic() + _CHECK_S
        self._patience_s = _FIRST_CHECK_S
        self._is_reported = False

    def has_begun(self, should_stop: Callable[[], bool]) -> bool:
        """Wait until the viewer takes data, and report its page; False if it ends or `should_stop` before.

        The page is reported only then: a browser that opens it before the server listens may take the
        server's port.
        """
        if self._process is None:  # another program started it
            return True
        if self._process.wait_until_it_listens(should_stop):
            if self._process.page is not None:
                self._report("info", f"viewer: open {self._process.page}")
            return True
        if self._process.has_ended():
            self._report_gone(_exit_code(self._process))
        return False

    def is_gone(self, stream: rr.RecordingStream) -> bool:
        """Whether the viewer has closed, checked every two seconds; reports it."""
        if time.monotonic() < self._next_s:
            return False
        why = self._why_gone(stream)
        self._patience_s = _CHECK_S
        self._next_s = time.monotonic() + _CHECK_S
        if why:
            self._report_gone(why)
        return bool(why)

    def _why_gone(self, stream: rr.RecordingStream) -> str:
        """Why the viewer has closed; empty if it runs."""
        if self._process is not None and self._process.has_ended():
            return _exit_code(self._process)
        try:
            stream.flush(timeout_sec=self._patience_s)
            self._is_reported = False
        except RuntimeError as error:
            if "timed out" not in str(error):
                return str(error)
            self.takes_nothing()
        return ""

    def _report_gone(self, why: str) -> None:
        text = f"viewer {self._viewer} is closed ({why}); the run goes on without it"
        self._report("warning", text)

    def takes_nothing(self) -> None:
        """Report that the viewer takes no data, once until it takes data again."""
        if not self._is_reported:
            self._is_reported = True
            self._report("warning", f"viewer {self._viewer} takes no data; the run goes on")


def _exit_code(process: ViewerProcess) -> str:
    return f"exit code {process.exit_code}"
