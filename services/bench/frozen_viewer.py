"""A viewer that is frozen for a while, together with what serves it."""

import contextlib
import signal
import time
from pathlib import Path
from typing import Any

import psutil

from hsslam_node.services.bench.attached_viewer import AttachedViewer

FROZEN_S = 10.0
_FLOWING_BYTES = 400_000  # a dozen images: the camera is being tracked


class FrozenViewer(AttachedViewer):
    """Takes data, then is stopped (SIGSTOP) for ten seconds, then goes on."""

    def __init__(self, run_folder: Path) -> None:
        super().__init__(run_folder)
        self._frozen: list[psutil.Process] = []
        self._window_ns: list[int] = []  # of the frozen time, wall clock

    def poll(self) -> None:
        """Freeze it when data flows, thaw it when its time is over."""
        super().poll()
        if not self._window_ns and self.received_bytes > _FLOWING_BYTES:
            self._frozen = _programs_of_rerun()
            self._signal(signal.SIGSTOP)
        elif len(self._window_ns) == 1 and time.time_ns() - self._window_ns[0] > 1e9 * FROZEN_S:
            self._signal(signal.SIGCONT)

    def close(self) -> None:
        """Thaw and end it."""
        if len(self._window_ns) == 1:
            self._signal(signal.SIGCONT)
        super().close()

    def found(self) -> dict[str, Any]:
        """Bytes that it took, and from when to when it was frozen."""
        return {**super().found(), "frozen_ns": self._window_ns}

    def _signal(self, number: signal.Signals) -> None:
        self._window_ns.append(time.time_ns())
        for process in self._frozen:
            with contextlib.suppress(psutil.Error):
                process.send_signal(number)


def _programs_of_rerun() -> list[psutil.Process]:
    """The viewer and the server of its data, wherever they are below this process."""
    below = psutil.Process().children(recursive=True)
    return [process for process in below if process.name() == "rerun"]
