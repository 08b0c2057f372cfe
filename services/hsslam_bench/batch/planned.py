"""Plans batches of logs, and has the command of `hsslam-batch`; apart, as several rows use both."""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from hsslam_batch.plan.batch import Batch
from hsslam_batch.plan.read_batch import read_batch

_PYTHON = (sys.executable, "-P", "-m")
_LOGS, _QUICK_LOGS = 2000, 20


def batch_command(*words: str) -> list[str]:
    """The command line of `hsslam-batch` with these words."""
    return [*_PYTHON, "hsslam_batch", *words]


def plan(logs: Path, out: Path, *options: str) -> Batch:
    """Plan a batch of all logs below a folder."""
    command = batch_command("plan", str(logs), "--out", str(out), *options)
    subprocess.run(command, check=True, stdout=sys.stderr)
    return read_batch(str(out))


def planned(folder: Path, count: int) -> Batch:
    """Plan a batch of `count` new logs of one frame."""
    logs = folder / "logs"
    make = [*_PYTHON, "hsslam_bench.batch.small_log", str(logs), str(count)]
    subprocess.run(make, check=True, stdout=sys.stderr)
    return plan(logs, folder / "out")


def report_on_many(
    name: str, document: str | None, measure: Callable[[Batch], Mapping[str, Any]]
) -> None:
    """Body of a row's `main`: plan many logs of one frame, and print the result of `measure` as JSON."""
    parser = argparse.ArgumentParser(prog=name, description=document)
    parser.add_argument("--logs", type=int, default=_LOGS)
    parser.add_argument("--quick", action="store_true", help=f"{_QUICK_LOGS} logs")
    arguments = parser.parse_args()
    count = _QUICK_LOGS if arguments.quick else arguments.logs
    with tempfile.TemporaryDirectory() as folder:
        print(json.dumps(measure(planned(Path(folder), count))))
