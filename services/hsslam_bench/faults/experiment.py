"""The context of an experiment: a folder, and runs and processes that end with it."""

import contextlib
import os
import subprocess
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from hsslam_bench.runs.live_run import LiveRun


class Experiment:
    """Starts runs and processes in `folder`, and ends them when the context ends.

    It kills only processes that it started.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._runs: list[LiveRun] = []
        self._processes: list[subprocess.Popen] = []

    def serve(self, *options: str, out: Path | None = None, prefix: Sequence[str] = ()) -> LiveRun:
        """Start `hsslam-serve`; `prefix`: words before the command."""
        place = out or self.folder / f"run{len(self._runs)}"
        self._runs.append(LiveRun(place, *options, prefix=tuple(prefix)))
        return self._runs[-1]

    def start(self, *command: str, **fields: Any) -> subprocess.Popen:
        """Start another process."""
        self._processes.append(subprocess.Popen(command, **fields))
        return self._processes[-1]

    def __enter__(self) -> "Experiment":
        self.folder.mkdir(parents=True, exist_ok=True)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """End all runs and processes."""
        for run in self._runs:
            run.close()
        for process in self._processes:
            with contextlib.suppress(OSError):
                process.kill()
            process.wait()


def with_shared_memory(size: str) -> tuple[str, ...]:
    """Words before a command that give it its own /dev/shm; `size` as for tmpfs ("24m").

    Needs root.
    """
    mount = f'mount -t tmpfs -o size={size} tmpfs /dev/shm && exec "$@"'
    return ("unshare", "-m", "sh", "-c", mount, "sh")


def can_mount() -> bool:
    """Whether this process may create mount namespaces, as root can outside of most containers."""
    return os.geteuid() == 0 and os.system("unshare -m true 2>/dev/null") == 0
