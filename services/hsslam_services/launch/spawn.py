"""Starting a process of a run as a fresh interpreter, and what it leaves in its log."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO, Protocol

from hsslam_services.launch.process_table import environment_of_threads
from hsslam_services.run.memory import RETURN_FREED_MEMORY_OF_RERUN
from hsslam_services.run.process_result import read_result

# glibc gives memory of this size back to the system when it is freed, and the system clears it again
# for the next image: half the time of preparing a reference keyframe. Keep it, but not in every thread,
# nor in processes that return it (`ProcessSpec.returned_bytes`); other C libraries do not read these.
_KEPT_MEMORY = {
    "MALLOC_MMAP_THRESHOLD_": str(32 << 20),  # bytes; the largest that glibc takes
    "MALLOC_TRIM_THRESHOLD_": str(128 << 20),
    "MALLOC_ARENA_MAX": "2",  # else each of many threads keeps memory of its own
    **RETURN_FREED_MEMORY_OF_RERUN,
}


class Process(Protocol):
    """What supervision asks of a process; `subprocess.Popen` is one."""

    @property
    def pid(self) -> int | None: ...
    def poll(self) -> int | None: ...
    def wait(self, timeout: float | None = None) -> int: ...
    def send_signal(self, sig: int) -> None: ...
    def kill(self) -> None: ...


Spawn = Callable[[str, Path], Process]
NOT_STARTED = 127  # exit code of a process that the system did not start, as a shell has it


def module_command(module: str, run_dir: str) -> list[str]:
    """The command line of a process of a run.

    -P keeps the working folder out of sys.path: a checkout or a stranger's torch.py there is not imported.
    """
    return [sys.executable, "-P", "-m", module, "--run", run_dir]


def spawn(module: str, run_dir: Path) -> subprocess.Popen:
    """Start `python -m <module> --run <run_dir>` in a session of its own, its output in logs/."""
    with open_log(run_dir, module) as log:
        return subprocess.Popen(
            module_command(module, str(run_dir)),
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            env=child_environment(),
            start_new_session=True,
        )


def child_environment() -> Mapping[str, str]:
    """Variables of every process of a run: one numeric thread, the allocator."""
    return {
        **_KEPT_MEMORY,
        **os.environ,
        **environment_of_threads(1),
        "PYTHONUNBUFFERED": "1",
    }


def open_log(run_dir: Path, module: str) -> IO[bytes]:
    """The log of a process, to append to."""
    log_file = log_path(run_dir, module)
    log_file.parent.mkdir(exist_ok=True)
    return log_file.open("ab")


def log_path(run_dir: Path, module: str) -> Path:
    """Where a process's own output goes."""
    return run_dir / "logs" / f"{process_name(module)}.log"


def process_name(module: str) -> str:
    """Name of the process that runs this module: of its log and of its result."""
    return module.rpartition(".")[2]


def last_error(run_dir: Path, module: str) -> str:
    """Why a process failed: the line that it has left, else where its log is."""
    error = read_result(run_dir, process_name(module)).error
    return error or f"{process_name(module)} failed; see {log_path(run_dir, module)}"


def not_started(error: BaseException) -> str:
    """Why the system did not start a process, in words."""
    reason = error.strerror if isinstance(error, OSError) else ""
    return f"cannot be started: {reason or error or type(error).__name__}"


def how_it_ended(code: int) -> str:
    """An exit code in words."""
    if code == NOT_STARTED:
        return "cannot be started"
    return f"was killed by {signal.Signals(-code).name}" if code < 0 else f"exited with code {code}"
