"""Viewers of a run with `--viewer web`: rerun's own client without a window, running or frozen."""

import contextlib
import os
import signal
import subprocess
import time
from collections.abc import Collection
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlparse

import psutil
import rerun_cli

_URL_LINE = "viewer: open "  # in the log of the process that serves the page
_END_S = 5.0
FROZEN_S = 10.0
_FLOWING_BYTES = 400_000  # a dozen images, so the tracker has started
# least share of the seconds with poses in which an attached viewer receives data
LOOKED_SHARE = 0.8


def looked_share(seconds: Collection[int], begin_ns: int, end_ns: int) -> float:
    """Share of the seconds between two times (wall clock) in which the viewer received data (`seconds`)."""
    wanted = range(begin_ns // 10**9, end_ns // 10**9 + 1)
    return len(set(wanted).intersection(seconds)) / len(wanted)


class AttachedViewer:
    """Connects to the same address as the page of the web viewer, and receives all data.

    `rerun --save /dev/null URL` subscribes as the page does, decodes every message and discards it. It draws
    nothing, since a browser draws on its user's machine.
    """

    def __init__(self, run_folder: Path) -> None:
        self._run_folder = run_folder
        self._since_s = time.time()
        self._process: subprocess.Popen | None = None
        self.received_bytes = 0
        self._seconds: set[int] = set()

    def poll(self) -> None:
        """Attach once there is a page, again if the client has ended; count the received bytes."""
        if self._process is not None and self._process.poll() is None:
            if (so_far := _written_bytes(self._process.pid)) > self.received_bytes:
                self.received_bytes = so_far
                self._seconds.add(time.time_ns() // 10**9)
            return
        url = _served_url(self._run_folder, self._since_s)
        if url is not None:
            program = str(Path(rerun_cli.__file__).parent / "rerun")
            self._process = subprocess.Popen(
                [program, "--bind", "127.0.0.1", "--port", "auto", "--save", os.devnull, url],
                env=os.environ | {"RUST_LOG": "error"},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )

    def found(self) -> dict[str, Any]:
        """Received bytes, and the seconds of the wall clock with data."""
        return {"viewer_bytes": self.received_bytes, "viewer_seconds": sorted(self._seconds)}

    def close(self) -> None:
        """End the client if it still runs."""
        if self._process is not None:
            self._process.terminate()
            try:
                self._process.wait(_END_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()


def _served_url(run_folder: Path, since_s: float) -> str | None:
    """The URL from which the page of the run gets its data; None: no log newer than `since_s` has it.

    Older logs are of an earlier run in the same folder.
    """
    with contextlib.suppress(FileNotFoundError):  # the new run replaces the folder
        for log in (run_folder / "logs").glob("*.log"):
            lines = log.read_text(errors="replace") if log.stat().st_mtime >= since_s else ""
            for line in lines.splitlines():
                _, is_found, page = line.partition(_URL_LINE)
                if is_found:
                    return parse_qs(urlparse(page.strip()).query).get("url", [None])[0]
    return None


def _written_bytes(pid: int) -> int:
    try:
        return psutil.Process(pid).io_counters().write_chars
    except (psutil.Error, OSError):
        return 0


class FrozenViewer(AttachedViewer):
    """Receives data, is stopped (SIGSTOP) for ten seconds, then continues."""

    def __init__(self, run_folder: Path) -> None:
        super().__init__(run_folder)
        self._frozen: list[psutil.Process] = []
        self._window_ns: list[int] = []  # of the frozen time, wall clock

    def poll(self) -> None:
        """Stop the viewer once data flows; continue it after ten seconds."""
        super().poll()
        if not self._window_ns and self.received_bytes > _FLOWING_BYTES:
            self._frozen = _programs_of_rerun()
            self._signal(signal.SIGSTOP)
        elif len(self._window_ns) == 1 and time.time_ns() - self._window_ns[0] > 1e9 * FROZEN_S:
            self._signal(signal.SIGCONT)

    def close(self) -> None:
        """Continue the viewer, and end it."""
        if len(self._window_ns) == 1:
            self._signal(signal.SIGCONT)
        super().close()

    def found(self) -> dict[str, Any]:
        """The figures of `AttachedViewer`, and the frozen interval."""
        return {**super().found(), "frozen_ns": self._window_ns}

    def _signal(self, number: signal.Signals) -> None:
        self._window_ns.append(time.time_ns())
        for process in self._frozen:
            with contextlib.suppress(psutil.Error):
                process.send_signal(number)


def _programs_of_rerun() -> list[psutil.Process]:
    """The processes of the viewer and of its data server, at any depth below this process."""
    below = psutil.Process().children(recursive=True)
    return [process for process in below if process.name() == "rerun"]
