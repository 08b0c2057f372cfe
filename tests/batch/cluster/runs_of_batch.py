"""A `hsslam-batch run` that goes on, and what lives of its runs; apart, as several tests kill some of it."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import psutil

from hsslam_batch.plan.batch import Batch
from hsslam_batch.plan.command import plan_command
from hsslam_batch.plan.log import read_manifest
from hsslam_batch.plan.read_batch import read_batch
from hsslam_services.bus.dead_pools import POOL_BYTES, pools_of
from tests.services.serve_process import QUICK

LONG_S = 3000
_MEMORY = ("--memory", "4")
_SERVE, _WORK = "hsslam_services.commands.serve", "hsslam_batch work"


def planned(logs: Path | str, out: Path | str) -> Batch:
    """The plan of these logs, paths or URLs."""
    plan_command([str(logs), "--out", str(out), *QUICK])
    return read_batch(str(out))


def start(batch: Batch, *options: str) -> subprocess.Popen[str]:
    """The command; it prints to a pipe."""
    command = [sys.executable, "-m", "hsslam_batch", "run", batch.place, *_MEMORY, *options]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    )


def start_unread(batch: Batch, *options: str) -> subprocess.Popen[bytes]:
    """The command; the reader of what it prints is gone."""
    readable, writable = os.pipe()
    os.close(readable)
    command = [sys.executable, "-m", "hsslam_batch", "run", batch.place, *_MEMORY, *options]
    try:
        return subprocess.Popen(command, stdout=writable, stderr=writable, start_new_session=True)
    finally:
        os.close(writable)


def end(run: subprocess.Popen[str]) -> str:
    """What it printed."""
    said, _ = run.communicate(timeout=LONG_S)
    return said


def wait(condition: Callable[[], object]) -> None:
    """Wait until it holds."""
    deadline = time.monotonic() + LONG_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def of_batch(batch: Batch) -> list[psutil.Process]:
    """Processes that live and name a run of the batch."""
    return [
        process
        for process in psutil.process_iter(["cmdline", "status"])
        if str(batch.work) in " ".join(process.info["cmdline"] or [])
        and process.info["status"] != psutil.STATUS_ZOMBIE
    ]


def arenas(batch: Batch) -> dict[str, Path]:
    """Shared memory of runs of the batch, by run folder."""
    found = {}
    for owner in Path("/dev/shm").glob("hsslam-*/owner.json"):
        run_dir = json.loads(owner.read_text())["run_dir"]
        if run_dir.startswith(str(batch.work)):
            found[run_dir] = owner.parent
    return found


def services(batch: Batch) -> list[psutil.Process]:
    """The `hsslam-serve` of each run that is at work: its shared memory is there."""
    folders = arenas(batch)
    return [
        process
        for process in of_batch(batch)
        if _SERVE in process.info["cmdline"] and folders.keys() & {*process.info["cmdline"]}
    ]


def worker_of(service: psutil.Process) -> psutil.Process:
    """The Ray worker that has started the `hsslam-batch work` that watches a run."""
    above = service.parents()
    (k,) = (k for k, each in enumerate(above) if _WORK in " ".join(each.cmdline()))
    return above[k + 1]


def loose_pools() -> set[Path]:
    """Pools of zenoh, 32 MB each, that no process has open. Its table of 1.3 MB stays after any run until the
    next program uses zenoh."""
    found = {p for p in Path("/dev/shm").glob("*.zenoh") if p.stat().st_size > POOL_BYTES // 2}
    loose = found.difference(*(pools_of(pid) for pid in psutil.pids()))
    return {path for path in loose if path.exists()}  # a process may have removed it meanwhile


def nothing_left(batch: Batch, pools: set[Path]) -> bool:
    """Whether no process and no shared memory of any run is left; `pools`: those loose before the batch."""
    return not of_batch(batch) and not arenas(batch) and loose_pools() <= pools


def trajectories(batch: Batch) -> dict[str, bytes]:
    """Those that count, by name of the log."""
    return {
        log.name: (batch.run_dir(log.id) / "trajectory.txt").read_bytes()
        for log in read_manifest(batch.out)
        if batch.done_file(log.id).exists()
    }


def by_hand(batch: Batch, folder: Path) -> dict[str, bytes]:
    """The trajectories that a user makes, one log after the other."""
    found = {}
    for log in read_manifest(batch.out):
        if log.name.startswith("good"):
            out = folder / log.name
            serve = [sys.executable, "-m", _SERVE, "--source", log.source]
            options = ["--out", str(out), "--pace", "lockstep", "--viewer", "none", *QUICK]
            subprocess.run([*serve, *options], check=True, capture_output=True, timeout=LONG_S)
            found[log.name] = (out / "trajectory.txt").read_bytes()
    return found
