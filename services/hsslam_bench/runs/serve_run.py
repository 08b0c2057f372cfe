"""One run of `hsslam-serve` as a user makes it, and its results."""

import contextlib
import dataclasses
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import psutil

from hsslam_bench.runs.cpu_quota import NoQuotaError, cpu_quota
from hsslam_bench.runs.left_behind import LeftBehind
from hsslam_bench.runs.run_log import LogContent, read_log
from hsslam_bench.runs.usage import Sample, Usage, core_ms_per_frame
from hsslam_services.bus.bus import free_endpoint
from hsslam_services.run.summary import read_summary

_TIMEOUT_S = 3600.0
_TOO_LONG = f"ended after {_TIMEOUT_S:.0f} s, before its last frame"
_POLL_S = 0.2
_MAP = "map.safetensors"
_BULKY = ("run*.mcap", "run*.rrd", _MAP)  # removed after they are read


class Watcher(Protocol):
    """Watches a run while it runs."""

    def poll(self) -> None: ...


class Outsider(Watcher, Protocol):
    """An external viewer or client of a run."""

    def close(self) -> None: ...

    def found(self) -> Mapping[str, Any]: ...


class RunFailedError(Exception):
    """A process of the benchmark failed."""


@dataclass(frozen=True)
class ServeRun:
    """A finished run."""

    name: str
    folder: Path
    command: Sequence[str]
    started_ns: int  # wall clock, just before the command
    seconds: float
    exit_code: int
    error: str  # last line of output if it failed
    summary: Mapping[str, Any]
    log: LogContent
    view_error: str  # of run.rrd; "": it opens
    usage: Sequence[Sample] = ()
    disk_bytes: Mapping[str, int] = field(default_factory=dict)  # by file of the run folder
    outside: Mapping[str, Any] = field(default_factory=dict)  # figures of the outsider
    left_behind: Sequence[str] = field(default_factory=tuple)  # processes, port, shared memory

    @property
    def viewer_bytes(self) -> int | None:
        """Bytes that the attached viewer received; None without a viewer."""
        return self.outside.get("viewer_bytes")

    @property
    def core_ms(self) -> dict[str, float]:
        """Core time of each process while frames were tracked, ms a sensor frame."""
        return self.core_ms_of_last(None)

    def core_ms_of_last(self, frames: int | None) -> dict[str, float]:
        """As `core_ms`, over the last frames (None: all)."""
        window = self.log.tracking_ns
        if window is None or len(self.usage) < 2:
            return {}
        last = max(pose.index for pose in self.log.poses)
        inside = [p for p in self.log.poses if p.publish_ns >= window[0]]
        if frames is not None:
            inside = [p for p in inside if p.index > last - frames] or inside
        first = min(inside, key=lambda pose: pose.index)
        return core_ms_per_frame(self.usage, (first.publish_ns, window[1]), last - first.index)

    def as_json(self) -> dict[str, Any]:
        """The run for the result file, with its configuration."""
        fields = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        command = self.command[2:]
        return {**fields, "folder": self.folder.name, "command": command, "core_ms": self.core_ms}


def serve(
    name: str,
    folder: Path,
    options: Sequence[str],
    environment: Mapping[str, str] | None = None,
    *,
    viewer: str = "none",
    outsider: Callable[[Path], Outsider] | None = None,
    cores: float | None = None,
    keeps_map: bool = False,
) -> ServeRun:
    """Run the service to its end in `folder`, an absolute path; then remove bulky results.

    `cores`: processor time that the service gets, on two cores (None: the whole machine). `outsider` makes a
    viewer or client from the folder. `keeps_map`: keep the map.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    port = int(free_endpoint().rpartition(":")[2])
    places = ("--viewer", viewer, "--out", str(folder), "--zenoh-port", str(port))
    command = [sys.executable, "-P", "-m", "hsslam_services.commands.serve", *places, *options]
    messages = folder.parent / f"{name}.stderr"
    with messages.open("wb") as stderr:
        started_ns = time.time_ns()
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=stderr, stderr=stderr, env=environment
        )
        usage = Usage(psutil.Process(process.pid), folder)
        left_behind = LeftBehind(folder, port, process.pid)
        client = outsider(folder) if outsider else None
        try:
            with cpu_quota(process.pid, cores, 2) if cores else contextlib.nullcontext():
                watchers = [usage, left_behind, *([client] if client else [])]
                is_whole = _wait(process, watchers)
        except NoQuotaError:
            process.terminate()
            process.wait()
            raise
        finally:
            if client:
                client.close()
        ended_ns = time.time_ns()
    error = _last_line(messages) if process.returncode else ""
    run = ServeRun(
        name=name,
        folder=folder,
        command=command,
        started_ns=started_ns,
        seconds=(ended_ns - started_ns) / 1e9,
        exit_code=process.returncode,
        error=error if is_whole else _TOO_LONG,
        summary=read_summary(folder),
        log=read_log(folder / "run.mcap"),
        view_error=_verify_view(folder),
        usage=usage.samples,
        disk_bytes=_sizes(folder),
        outside=client.found() if client else {},
        left_behind=tuple(left_behind.found()),
    )
    for pattern in _BULKY:
        for path in folder.glob(pattern):
            if not (keeps_map and path.name == _MAP):
                path.unlink()
    return run


def finished(run: ServeRun) -> ServeRun:
    """The run, if it succeeded.

    Raises:
        RunFailedError: the exit code is not 0, there is no summary, or the run took more than an hour.
    """
    if run.exit_code != 0 or run.error or not run.summary.get("frames"):
        raise RunFailedError(f"{run.name} ended with code {run.exit_code}: {run.error}")
    return run


def _wait(process: subprocess.Popen, watchers: Sequence[Watcher]) -> bool:
    """Wait for the end, and poll the watchers every 0.2 s; ends a run of an hour, and returns False then."""
    deadline = time.monotonic() + _TIMEOUT_S
    is_whole = True
    try:
        while process.poll() is None:
            if time.monotonic() > deadline:
                process.terminate()
                process.wait()
                is_whole = False
            for watcher in watchers:
                watcher.poll()
            time.sleep(_POLL_S)
    except KeyboardInterrupt:  # the service got the signal, too, and saves its results
        process.wait()
        raise
    return is_whole


def _sizes(folder: Path) -> dict[str, int]:
    return {str(p.relative_to(folder)): p.stat().st_size for p in folder.rglob("*") if p.is_file()}


def _verify_view(folder: Path) -> str:
    files = map(str, sorted(folder.glob("run*.rrd")))
    command = [sys.executable, "-P", "-m", "rerun", "rrd", "verify", *files]
    result = subprocess.run(command, capture_output=True, text=True)
    return "" if result.returncode == 0 else (result.stderr.strip() or "rrd verify failed")


def _last_line(path: Path) -> str:
    lines = [line for line in path.read_text(errors="replace").splitlines() if line.strip()]
    return lines[-1] if lines else "no message"
