"""The result file of a benchmark: rows, machine, versions and protocol."""

import importlib.metadata
import os
import platform
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import psutil

from hsslam_bench.checks.check import Row
from hsslam_bench.runs.sequences import QUICK_FRAMES
from hsslam_bench.runs.session import Session
from hsslam_node.errors import UserError
from hsslam_services.run.run_info import write_atomically
from hsslam_services.run.summary import source_commit

_PACKAGES = (
    *("hsslam-node", "torch", "numpy", "numba", "opencv-python-headless", "eclipse-zenoh"),
    *("mcap", "rerun-sdk"),
)
VERSION = 1


class Machine(msgspec.Struct, frozen=True):
    """The machine of a measurement, and its load."""

    cpu: str
    cores: int
    memory_bytes: int
    system: str
    load_before: float  # runnable processes, mean of the last minute


class Report(msgspec.Struct, frozen=True):
    """One result file. New fields have defaults; a change that breaks older readers raises `version`."""

    time: str  # of the start, UTC
    # "": not a git checkout; a trailing +: changed files; "A, B": the checkout changed during the benchmark
    commit: str
    machine: Machine
    versions: dict[str, str]
    protocol: dict[str, Any]
    rows: tuple[Row, ...]
    runs: list[dict[str, Any]] = []
    version: int = VERSION


def machine() -> Machine:
    """This machine with its current load."""
    return Machine(
        cpu=_cpu_model(),
        cores=len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 0,
        memory_bytes=psutil.virtual_memory().total,
        system=f"{platform.system()} {platform.release()}",
        load_before=psutil.getloadavg()[0],
    )


def report(session: Session, rows: Sequence[Row] = ()) -> Report:
    """The report of a session that starts now."""
    protocol = {
        "quick": session.quick,
        "extra_options": list(session.extra),
        "seeds": list(session.seeds),
        "frames": QUICK_FRAMES if session.quick else "all",
        "ate": "RMSE over camera centres, SE(3) alignment without scale, 20 ms association",
        "latency": "sensor stamp to published pose, without the first pose",
        "first_pose": "from just before the command; of the first frame that is aligned to the map",
        "kernels": "median of 7, float32, kernel and reference in turn in one process",
    }
    return Report(
        time=time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        commit=source_commit(),
        machine=machine(),
        versions={
            "python": platform.python_version(),
            **{name: importlib.metadata.version(name) for name in _PACKAGES},
        },
        protocol=protocol,
        rows=tuple(rows),
        runs=[run.as_json() for run in session.runs.values()],
    )


def with_rows(earlier: Report, session: Session, rows: Sequence[Row]) -> Report:
    """The report with these rows; if the checkout has changed, its commit is added."""
    commit, now = earlier.commit, source_commit()
    if now not in commit.split(", "):
        commit = f"{commit}, {now}"
    runs = [run.as_json() for run in session.runs.values()]
    return msgspec.structs.replace(earlier, commit=commit, rows=tuple(rows), runs=runs)


def write_report(path: Path, result: Report) -> None:
    """Write the report as JSON; figures that are not finite become null.

    Raises:
        UserError: the file is not writable.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, msgspec.json.format(msgspec.json.encode(result)))
    except OSError as error:
        raise UserError(f"--out {path}: {error.strerror}: expected a file to write") from None


def read_report(path: Path) -> Report:
    """Read a file of `write_report`.

    Raises:
        UserError: the file is missing, no result file, or of another version.
    """
    try:
        content = path.read_bytes()
        version = msgspec.json.decode(content, type=_Version).version
        if version != VERSION:
            raise UserError(
                f"{path}: a result of version {version}: expected version {VERSION}: "
                "read it with the benchmark that wrote it, or measure again"
            )
        return msgspec.json.decode(content, type=Report)
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}: expected a result of the benchmark") from None
    except msgspec.MsgspecError as error:
        raise UserError(f"{path}: {error}: expected a result of the benchmark") from None


class _Version(msgspec.Struct):
    version: int = VERSION


def _cpu_model() -> str:
    """Name, family and model, since virtual machines give several generations one name."""
    info = Path("/proc/cpuinfo")
    if not info.exists():
        return platform.processor() or platform.machine()
    first = dict(_named(line) for line in info.read_text().partition("\n\n")[0].splitlines())
    name = first.get("model name", platform.machine())
    if "cpu family" not in first:
        return name
    return f"{name} (family {first['cpu family']}, model {first.get('model', '?')})"


def _named(line: str) -> tuple[str, str]:
    name, _, value = line.partition(":")
    return name.strip(), value.strip()
