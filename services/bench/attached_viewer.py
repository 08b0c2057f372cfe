"""A viewer attached to a run with `--viewer web`: rerun's own client, without a window."""

import os
import subprocess
from pathlib import Path
from urllib.parse import parse_qs, urlparse

import psutil
import rerun_cli

_TOLD = "viewer: open "  # in the log of the process that serves the page
_END_S = 5.0


class AttachedViewer:
    """Connects to the address that the page of the web viewer connects to, and takes all data.

    `rerun --save /dev/null URL` subscribes as the page does, decodes every message and writes it
    away. It draws nothing: a browser draws on its user's machine.
    """

    def __init__(self, run_folder: Path) -> None:
        self._run_folder = run_folder
        self._process: subprocess.Popen | None = None
        self.received_bytes = 0

    def poll(self) -> None:
        """Attach as soon as there is a page, again if it was too early; read how much has come."""
        if self._process is not None and self._process.poll() is None:
            self.received_bytes = max(self.received_bytes, _written_bytes(self._process.pid))
            return
        url = _served_url(self._run_folder)
        if url is not None:
            program = str(Path(rerun_cli.__file__).parent / "rerun")
            self._process = subprocess.Popen(
                [program, "--bind", "127.0.0.1", "--port", "auto", "--save", os.devnull, url],
                env=os.environ | {"RUST_LOG": "error"},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )

    def found(self) -> dict[str, int]:
        """Bytes that it took."""
        return {"viewer_bytes": self.received_bytes}

    def close(self) -> None:
        """End it if the end of the run has not."""
        if self._process is not None:
            self._process.terminate()
            try:
                self._process.wait(_END_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()


def _served_url(run_folder: Path) -> str | None:
    """Where the page of the run gets its data; None: it has not been told yet."""
    for log in (run_folder / "logs").glob("*.log"):
        for line in log.read_text(errors="replace").splitlines():
            _, told, page = line.partition(_TOLD)
            if told:
                return parse_qs(urlparse(page.strip()).query).get("url", [None])[0]
    return None


def _written_bytes(pid: int) -> int:
    try:
        return int(psutil.Process(pid).io_counters().write_chars)
    except (psutil.Error, OSError):
        return 0
