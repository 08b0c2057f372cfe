"""Starts a process of a run as a fresh interpreter; its log and its error."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO, Protocol

from hsslam_services.disk.disk_work import DiskWork
from hsslam_services.launch.process_table import environment_of_threads
from hsslam_services.run.memory import RETURN_FREED_MEMORY_OF_RERUN
from hsslam_services.run.process_result import ProcessResult

# By default, glibc returns freed memory of the size of images to the system, which clears it for the next
# image: half the time of preparing a reference keyframe. These variables let a process keep it, but not in
# each thread, nor if it returns arrays (`ProcessSpec.returned_bytes`). Other C libraries ignore them.
_KEPT_MEMORY = {
    "MALLOC_MMAP_THRESHOLD_": str(32 << 20),  # bytes; the maximum of glibc
    "MALLOC_TRIM_THRESHOLD_": str(128 << 20),
    "MALLOC_ARENA_MAX": "2",  # else each thread keeps memory of its own
    **RETURN_FREED_MEMORY_OF_RERUN,
}


class Process(Protocol):
    """The methods of a process that supervision needs; `subprocess.Popen` has them."""

    @property
    def pid(self) -> int | None: ...
    def poll(self) -> int | None: ...
    def wait(self, timeout: float | None = None) -> int: ...
    def send_signal(self, sig: int) -> None: ...
    def kill(self) -> None: ...


Spawn = Callable[[str, Path], Process]
NOT_STARTED = 127  # exit code if the system does not start a process, as in a shell


def module_command(module: str, run_dir: str) -> list[str]:
    """The command line of a process of a run.

    -P keeps the working folder out of sys.path, so that no checkout or foreign torch.py there is imported.
    """
    return [sys.executable, "-P", "-m", module, "--run", run_dir]


def spawn(module: str, run_dir: Path, disk: DiskWork | None = None) -> subprocess.Popen:
    """Start `python -m <module> --run <run_dir>` in its own session, with its output in logs/."""
    with open_log(run_dir, module, disk) as log:
        return subprocess.Popen(
            module_command(module, str(run_dir)),
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            env=child_environment(),
            start_new_session=True,
        )


def child_environment() -> Mapping[str, str]:
    """Environment variables of all processes of a run: one numeric thread, the allocator."""
    return {
        **_KEPT_MEMORY,
        **os.environ,
        **environment_of_threads(1),
        "PYTHONUNBUFFERED": "1",
    }


def open_log(run_dir: Path, module: str, disk: DiskWork | None = None) -> IO[bytes]:
    """Open the log of a process to append; /dev/null if `disk` does not answer in time."""
    log_file = log_path(run_dir, module)
    if disk is None:
        return _open_log(log_file)
    try:
        return disk.do(lambda: _open_log(log_file))
    except TimeoutError:
        return Path(os.devnull).open("ab")


def _open_log(log_file: Path) -> IO[bytes]:
    log_file.parent.mkdir(exist_ok=True)
    return log_file.open("ab")


def log_path(run_dir: Path, module: str) -> Path:
    """The file with the output of a process."""
    return run_dir / "logs" / f"{process_name(module)}.log"


def process_name(module: str) -> str:
    """Name of the process that runs this module, as in its log and its result."""
    return module.rpartition(".")[2]


def last_error(result: ProcessResult, run_dir: Path, module: str) -> str:
    """The error that a failed process left in its result; else a line that names its log."""
    return result.error or f"{process_name(module)} failed; see {log_path(run_dir, module)}"


def not_started(error: BaseException) -> str:
    """The error of a process that could not be started, in words."""
    reason = error.strerror if isinstance(error, OSError) else ""
    return f"cannot be started: {reason or error or type(error).__name__}"


def how_it_ended(code: int) -> str:
    """An exit code in words."""
    if code == NOT_STARTED:
        return "cannot be started"
    if code >= 0:
        return f"exited with code {code}"
    names = {each.value: each.name for each in signal.Signals}  # real-time signals have none
    return f"was killed by {names.get(-code, f'signal {-code}')}"
