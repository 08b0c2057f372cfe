"""One run of `hsslam-serve` as a user makes it, and everything that is read off it afterwards."""

import dataclasses
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import psutil
from mcap.exceptions import McapError
from mcap.reader import make_reader

from hsslam_node.services.bus import free_endpoint
from hsslam_node.services.run_info import RunInfo
from hsslam_node.services.summary import read_summary

_TIMEOUT_S = 3600.0
_POLL_S = 0.2
_BULKY = ("run*.mcap", "run*.rrd", "map.safetensors")  # removed once they have been looked at
_POSE_SUFFIX, _TRACKED = "/out/pose", "tracked"


class RunFailedError(Exception):
    """A process of the benchmark that did not end as it should."""


@dataclass(frozen=True)
class LogContent:
    """What the public reader finds in run.mcap. Times are wall clock; None: no such pose."""

    counts: Mapping[str, int]  # messages by topic, as "out/pose"
    first_pose_ns: int | None = None
    first_tracked_ns: int | None = None  # the first pose that was aligned to the map
    error: str = ""


@dataclass(frozen=True)
class ServeRun:
    """A finished run."""

    name: str
    folder: Path
    command: Sequence[str]
    started_ns: int  # wall clock, just before the command
    seconds: float
    exit_code: int
    error: str  # its last words if it failed
    summary: Mapping[str, Any]
    log: LogContent
    view_error: str  # of run.rrd; "" if it can be opened
    supervisor_peak_rss_bytes: int
    left_behind: Sequence[str] = field(default_factory=tuple)  # processes, port, shared memory

    def as_json(self) -> dict[str, Any]:
        """For the result file; the configuration stays, being what was measured."""
        fields = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        return {**fields, "folder": self.folder.name, "command": self.command[2:]}


def serve(
    name: str, folder: Path, options: Sequence[str], environment: Mapping[str, str] | None = None
) -> ServeRun:
    """Run the service to its end in `folder`, without a viewer; bulky results are not kept."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    port = int(free_endpoint().rpartition(":")[2])
    places = ("--viewer", "none", "--out", str(folder), "--zenoh-port", str(port))
    command = [sys.executable, "-m", "hsslam_node.services.serve", *places, *options]
    messages = folder.parent / f"{name}.stderr"
    with messages.open("wb") as stderr:
        started_ns = time.time_ns()
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=stderr, stderr=stderr, env=environment
        )
        peak = _wait(process, started_ns)
        ended_ns = time.time_ns()
    run = ServeRun(
        name=name,
        folder=folder,
        command=command,
        started_ns=started_ns,
        seconds=(ended_ns - started_ns) / 1e9,
        exit_code=process.returncode,
        error=_last_line(messages) if process.returncode else "",
        summary=read_summary(folder),
        log=_read_log(folder / "run.mcap"),
        view_error=_verify_view(folder / "run.rrd"),
        supervisor_peak_rss_bytes=peak,
        left_behind=_left_behind(folder, port),
    )
    for pattern in _BULKY:
        for path in folder.glob(pattern):
            path.unlink()
    return run


def finished(run: ServeRun) -> ServeRun:
    """The run, if it may be judged.

    Raises:
        RunFailedError: another exit code than 0, or no summary.
    """
    if run.exit_code != 0 or not run.summary.get("frames"):
        raise RunFailedError(f"{run.name} ended with code {run.exit_code}: {run.error}")
    return run


def _wait(process: subprocess.Popen, started_ns: int) -> int:
    """Wait for the end; returns the peak of the supervisor's resident memory, bytes."""
    peak = 0
    try:
        watched = psutil.Process(process.pid)
        while process.poll() is None:
            if time.time_ns() - started_ns > _TIMEOUT_S * 1e9:
                process.terminate()
                process.wait()
            try:
                peak = max(peak, watched.memory_info().rss)
            except psutil.Error:
                continue  # it has just ended
            time.sleep(_POLL_S)
    except KeyboardInterrupt:  # it got the signal, too, and saves what it has
        process.wait()
        raise
    return peak


def _read_log(path: Path) -> LogContent:
    counts: Counter[str] = Counter()
    first: dict[str, int] = {}
    try:
        with path.open("rb") as file:
            for _, channel, message in make_reader(file).iter_messages(log_time_order=False):
                counts["/".join(channel.topic.split("/")[-2:])] += 1
                if channel.topic.endswith(_POSE_SUFFIX) and _TRACKED not in first:
                    pose = msgspec.msgpack.decode(message.data)
                    first.setdefault("any", pose["publish_ns"])
                    first.setdefault(pose["status"], pose["publish_ns"])
    except (OSError, McapError) as error:
        return LogContent({}, error=f"{path.name}: {error}")
    return LogContent(dict(counts), first.get("any"), first.get(_TRACKED))


def _verify_view(path: Path) -> str:
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(path)]
    result = subprocess.run(command, capture_output=True, text=True)
    return "" if result.returncode == 0 else (result.stderr.strip() or "rrd verify failed")


def _left_behind(folder: Path, port: int) -> tuple[str, ...]:
    left = [
        f"process {process.pid}"
        for process in psutil.process_iter(["cmdline", "status"])
        if str(folder) in (process.info["cmdline"] or [])
        and process.info["status"] != psutil.STATUS_ZOMBIE
    ]
    if (folder / "run.json").exists() and (arena := RunInfo.read(folder).arena_dir):
        left += [arena] if Path(arena).exists() else []
    listening = any(
        c.status == psutil.CONN_LISTEN and c.laddr and c.laddr.port == port
        for c in psutil.net_connections("tcp")
    )
    return (*left, f"port {port}") if listening else tuple(left)


def _last_line(path: Path) -> str:
    lines = [line for line in path.read_text(errors="replace").splitlines() if line.strip()]
    return lines[-1] if lines else "no message"
