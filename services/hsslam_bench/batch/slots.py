"""Runs `hsslam-batch run` with the same logs in one slot and in two; prints JSON.

`python -m hsslam_bench.batch.slots SOURCE...` writes logs of each source and runs them twice. It measures the
core time of all processes of the command, separately for Ray with the driver and for the logs.
"""

import argparse
import contextlib
import json
import subprocess
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import psutil

from hsslam_batch.plan.log import read_manifest
from hsslam_batch.results.progress import PROGRESS
from hsslam_batch.results.runs_table import read_runs
from hsslam_bench.batch.planned import batch_command, plan
from hsslam_bench.batch.small_log import write_logs

_LOGS, _FRAMES = 2, 180  # of each source
_STEP = 30  # frames from the start of a log to the start of the next
_QUICK_LOGS, _QUICK_FRAMES = 1, 12
_MEMORY = ("--memory", "4")
_LOOK_S = 0.5
_OF_LOGS = "hsslam_batch work"


def main() -> None:
    parser = argparse.ArgumentParser(prog="batch.slots", description=__doc__)
    parser.add_argument("sources", nargs="+")
    parser.add_argument("--quick", action="store_true", help="few and short logs")
    arguments = parser.parse_args()
    count = _QUICK_LOGS if arguments.quick else _LOGS
    frames = _QUICK_FRAMES if arguments.quick else _FRAMES
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_logs(folder / "logs", arguments.sources, count, frames, _STEP)
        print(json.dumps({str(slots): in_slots(folder, slots) for slots in (1, 2)}))


def in_slots(folder: Path, slots: int) -> dict[str, Any]:
    """Run the logs below a folder in `slots` slots.

    `run_s`: wall time from the first log on; `command_s`: of the whole command. Core times: `logs_core_s` of
    the runs; `work_core_s` of `hsslam-batch work` without the runs; `start_core_s` of Ray and the driver
    before the first log; `ray_core_s` of both after that.
    """
    out = folder / f"out{slots}"
    batch = plan(folder / "logs", out)
    command = batch_command("run", str(out), "--parallel", str(slots), *_MEMORY)
    begin_s = time.monotonic()
    with (folder / f"out{slots}.txt").open("wb") as output:
        process = subprocess.Popen(command, stdout=output, stderr=output)
    times, start_core_s, progress = _CoreTimes(process.pid), None, out / PROGRESS
    while process.poll() is None:
        times.look()
        if start_core_s is None and progress.exists():
            start_core_s = times.ray_s
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(_LOOK_S)
    command_s = time.monotonic() - begin_s
    lines = progress.read_bytes().splitlines()
    first, *_, last = (msgspec.json.decode(line) for line in lines)
    rows = read_runs(batch.out)
    return {
        "logs": len(read_manifest(batch.out)),
        "done": sum(row["kind"] == "done" for row in rows),
        "frames": sum(row["frames"] for row in rows),
        "run_s": 1e-9 * (last["time_ns"] - first["time_ns"]),
        "command_s": command_s,
        "logs_core_s": sum(row["core_s"] for row in rows),
        "work_core_s": times.work_s,
        "ray_core_s": times.ray_s - (start_core_s or 0.0),
        "start_core_s": start_core_s,
        "load": psutil.getloadavg()[0],
    }


class _CoreTimes:
    """Core time of the processes below a command, as last measured."""

    def __init__(self, pid: int) -> None:
        self._root = psutil.Process(pid)
        self._ray: dict[int, float] = {}  # by process id
        self._work: dict[int, float] = {}

    @property
    def ray_s(self) -> float:
        return sum(self._ray.values())

    @property
    def work_s(self) -> float:
        return sum(self._work.values())

    def look(self) -> None:
        """Measure the core time of all live processes, except those below `hsslam-batch work`."""
        left = [self._root]
        while left:
            process = left.pop()
            with contextlib.suppress(psutil.Error):
                used, words = process.cpu_times(), " ".join(process.cmdline())
                is_work = _OF_LOGS in words
                times = self._work if is_work else self._ray
                times[process.pid] = used.user + used.system
                left += [] if is_work else process.children()


def mean_share(found: Sequence[Mapping[str, Any]]) -> float:
    """Core time of Ray and the driver from the first log on, as a share of the core time of all processes."""
    ray_s = sum(each["ray_core_s"] for each in found)
    return ray_s / sum(
        each["ray_core_s"] + each["work_core_s"] + each["logs_core_s"] for each in found
    )


if __name__ == "__main__":
    main()
