"""Planned batches of many small logs, and the command of `hsslam-batch`; apart, as several rows use them."""

import subprocess
import sys
from pathlib import Path

from hsslam_batch.plan.batch import Batch, read_batch

_PYTHON = (sys.executable, "-P", "-m")


def batch_command(*words: str) -> list[str]:
    """The command line of `hsslam-batch` with these words."""
    return [*_PYTHON, "hsslam_batch", *words]


def plan(logs: Path, out: Path, *options: str) -> Batch:
    """A batch of all logs below a folder."""
    command = batch_command("plan", str(logs), "--out", str(out), *options)
    subprocess.run(command, check=True, stdout=sys.stderr)
    return read_batch(str(out))


def planned(folder: Path, count: int) -> Batch:
    """A batch of new logs of one frame."""
    logs = folder / "logs"
    make = [*_PYTHON, "hsslam_bench.batch.small_log", str(logs), str(count)]
    subprocess.run(make, check=True, stdout=sys.stderr)
    return plan(logs, folder / "out")
