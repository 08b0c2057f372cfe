"""What a process of a run leaves for the supervisor: `logs/NAME.result.json` in the run folder."""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from hsslam_services.run.run_info import write_atomically


class ProcessResult(msgspec.Struct, frozen=True):
    """Why a process failed, its sections of summary.json, and what it answers to a request.

    `error`: one line for the user; empty if the process succeeded. `lacks_memory`: what it needs may be free
    later.
    """

    error: str = ""
    summary: dict[str, Any] = {}
    answer: dict[str, Any] = {}
    lacks_memory: bool = False


def write_result(run_dir: Path, name: str, result: ProcessResult) -> None:
    """Write the result of process `name` in one step."""
    path = _path(run_dir, name)
    path.parent.mkdir(exist_ok=True)
    write_atomically(path, msgspec.json.encode(result, enc_hook=python_number))


def read_result(run_dir: Path, name: str) -> ProcessResult:
    """The result of process `name`; an empty one if it has left none since `clear_result`."""
    try:
        return msgspec.json.decode(_path(run_dir, name).read_bytes(), type=ProcessResult)
    except (OSError, msgspec.MsgspecError):  # none, or one that the disk did not take
        return ProcessResult()


def clear_result(run_dir: Path, name: str) -> None:
    """Remove what an earlier process of this name has left."""
    _path(run_dir, name).unlink(missing_ok=True)


def python_number(value: Any) -> Any:
    """A NumPy number as Python's, for JSON.

    Raises:
        NotImplementedError: a value of another type.
    """
    if isinstance(value, np.generic):
        return value.item()
    raise NotImplementedError(type(value).__name__)


def _path(run_dir: Path, name: str) -> Path:
    return run_dir / "logs" / f"{name}.result.json"
