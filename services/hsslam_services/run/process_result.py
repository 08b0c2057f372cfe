"""Result of a process of a run, for the supervisor: `logs/NAME.result.json` in the run folder."""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from hsslam_services.run.run_info import write_atomically


class ProcessResult(msgspec.Struct, frozen=True):
    """Error of a process, its sections of summary.json, and its answer to a request.

    `error`: one line for the user; empty if the process succeeded. `lacks_memory`: it failed for lack of
    memory, so another try may succeed.
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
    """The result of process `name`; an empty result if it wrote none since `clear_result`."""
    try:
        return msgspec.json.decode(_path(run_dir, name).read_bytes(), type=ProcessResult)
    except (OSError, msgspec.MsgspecError):  # no file, or cut off by a full disk
        return ProcessResult()


def clear_result(run_dir: Path, name: str) -> None:
    """Remove the result of an earlier process of this name."""
    _path(run_dir, name).unlink(missing_ok=True)


def python_number(value: Any) -> Any:
    """A NumPy number as a Python number, for JSON.

    Raises:
        NotImplementedError: the value has another type.
    """
    if isinstance(value, np.generic):
        return value.item()
    raise NotImplementedError(type(value).__name__)


def _path(run_dir: Path, name: str) -> Path:
    return run_dir / "logs" / f"{name}.result.json"
