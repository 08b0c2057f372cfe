"""Runs good and bad logs as a batch on a cluster of three nodes, and the good ones by hand; prints JSON.

`python -m hsslam_bench.batch.fleet SOURCE...` writes short logs of each source, and four bad logs. It
runs `hsslam-batch` on a Ray cluster of this machine with three nodes of one core, and then `hsslam-serve` for
one good log after the other.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from hsslam_batch.plan.batch import Batch
from hsslam_batch.plan.log import Log, read_manifest
from hsslam_batch.results.runs_table import read_runs
from hsslam_bench.batch.bad_logs import write_bad_logs
from hsslam_bench.batch.planned import batch_command, plan
from hsslam_bench.batch.ray_nodes import add_node, ray_cluster
from hsslam_bench.batch.small_log import write_logs

_EACH, _FRAMES = 6, 60  # logs of a source, and their frames
_STEP = 25  # frames from the start of a log to the start of the next
_QUICK_EACH, _QUICK_FRAMES = 1, 12
_NODES, _MEMORY_GB, _TIMEOUT_S = 3, 4.0, 900.0


def main() -> None:
    parser = argparse.ArgumentParser(prog="batch.fleet", description=__doc__)
    parser.add_argument("sources", nargs="+")
    parser.add_argument("--timeout", type=float, default=_TIMEOUT_S)
    parser.add_argument("--quick", action="store_true", help="few and short logs")
    arguments = parser.parse_args()
    each = _QUICK_EACH if arguments.quick else _EACH
    frames = _QUICK_FRAMES if arguments.quick else _FRAMES
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_logs(folder / "logs", arguments.sources, each, frames, _STEP)
        bad = write_bad_logs(folder / "logs")
        batch = plan(folder / "logs", folder / "out")
        print(json.dumps(fleet(batch, bad, folder / "hand", arguments.timeout)))


def fleet(batch: Batch, bad: dict[str, str], hand: Path, timeout_s: float) -> dict[str, Any]:
    """Run a batch, and its good logs by hand; `bad`: the expected kind of row of each bad log.

    `same`: number of `good` logs whose trajectories are the same, byte for byte. `failed`: kind and reason of
    each failed log. `as_expected`: whether exactly the bad logs failed, of the expected kind, with one line.
    """
    with ray_cluster() as cluster:
        for _ in range(_NODES):
            add_node(cluster)
        limits = ("--memory", f"{_MEMORY_GB:g}", "--timeout", f"{timeout_s:g}")
        command = batch_command("run", str(batch.out), "--address", cluster.address, *limits)
        begin_s = time.monotonic()
        exit_code = subprocess.run(command, stdout=sys.stderr).returncode
        run_s = time.monotonic() - begin_s
    rows = {row["name"]: row for row in read_runs(batch.out)}
    failed = {n: (r["kind"], r["reason"]) for n, r in rows.items() if r["kind"] != "done"}
    good = [log for log in read_manifest(batch.out) if log.name not in bad]
    is_one_line = all(reason and "\n" not in reason for _, reason in failed.values())
    return {
        "exit_code": exit_code,
        "run_s": run_s,
        "good": len(good),
        "same": sum(_is_same(batch, log, hand / log.name) for log in good),
        "bad": len(bad),
        "failed": failed,
        "as_expected": is_one_line and {n: kind for n, (kind, _) in failed.items()} == bad,
        "rows": len(rows),
        "left": len(list(batch.work.iterdir())) if batch.work.exists() else 0,
    }


def _is_same(batch: Batch, log: Log, out: Path) -> bool:
    """Run the log by hand into `out`; returns whether its trajectory is that of the batch."""
    serve = [sys.executable, "-P", "-m", "hsslam_services.commands.serve"]
    options = ["--config", str(batch.config), "--source", log.source, "--out", str(out)]
    subprocess.run([*serve, *options], check=True, stdout=subprocess.DEVNULL)
    made = batch.run_dir(log.id) / "trajectory.txt"
    return made.exists() and made.read_bytes() == (out / "trajectory.txt").read_bytes()


if __name__ == "__main__":
    main()
