"""Measures the time of `hsslam-batch run` on a batch without logs left; prints JSON.

`python -m hsslam_bench.batch.again [--logs N]` plans logs of one frame, commits a result for each, and runs
the command twice: the first run writes `runs.parquet`, the second finds it.
"""

import resource
import subprocess
import time

from hsslam_batch.attempt.commit import commit
from hsslam_batch.attempt.outcome import Outcome
from hsslam_batch.plan.batch import Batch
from hsslam_batch.plan.log import read_manifest
from hsslam_bench.batch.planned import batch_command, report_on_many


def main() -> None:
    report_on_many("batch.again", __doc__, again)


def again(batch: Batch) -> dict[str, float]:
    """Wall and core time of the first and the second command, s; number of logs that it counts as done."""
    for log in read_manifest(batch.out):
        run_dir = batch.work / log.id
        run_dir.mkdir(parents=True)
        (run_dir / "summary.json").write_text(log.name)
        configuration = batch.about.configuration
        commit(batch, Outcome(log.id, log.name, configuration, 1, "done"), run_dir)
    found: dict[str, float] = {}
    printed = ""
    for name in ("first", "second"):
        begin_s, begin_core_s = time.monotonic(), _core_s()
        command = batch_command("run", str(batch.out))
        printed = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
        found[f"{name}_s"] = time.monotonic() - begin_s
        found[f"{name}_core_s"] = _core_s() - begin_core_s
    return {"done": int(printed.split()[0]), **found}


def _core_s() -> float:
    """Core time of all commands that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main()
