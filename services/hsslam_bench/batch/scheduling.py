"""Measures the costs of scheduling a log whose run takes no time, in a process of its own; prints JSON.

`python -m hsslam_bench.batch.scheduling [--logs N]` plans logs of one frame and runs them as `hsslam-batch
run` does, on a new Ray on this machine. The command of each attempt is `echo`, which prints a result at once.
So the time that an attempt holds its slot is the time of Ray, worker, process and driver.
"""

import platform
import time
from collections.abc import Sequence
from typing import Any

import msgspec
import psutil

from hsslam_batch.attempt.outcome import Ended, Outcome
from hsslam_batch.cluster.batch_run import BatchRun, Stop
from hsslam_batch.cluster.connect import connected
from hsslam_batch.cluster.drive import Try, drive
from hsslam_batch.cluster.ray_pool import RayPool, Share
from hsslam_batch.cluster.task import TaskResult, perform_command
from hsslam_batch.plan.batch import Batch
from hsslam_batch.plan.log import Log, read_manifest
from hsslam_batch.results.progress import BatchProgress
from hsslam_batch.results.tally import Tally
from hsslam_bench.batch.planned import report_on_many

_WARM_UP = 0.1  # of the logs; memory and time count after these
_SHARE = Share(cpus=1.0, memory_gb=0.1)


def main() -> None:
    report_on_many("batch.scheduling", __doc__, scheduling)


def scheduling(batch: Batch) -> dict[str, float]:
    """Schedule all logs of a batch; returns time and memory.

    `slot_ms`: time of a slot a log. `driver_ms`, `ray_ms`: core time a log of this process, and of Ray's
    processes with the commands. `memory_mb`, `last_memory_mb`: memory of this process after a tenth of the
    logs, and at the end.
    """
    logs = read_manifest(batch.out)
    with connected("local"), BatchProgress(batch, Tally(logs, [])) as progress:
        pool = RayPool(_echo, lambda one: [_result(batch, logs[one.index])], _SHARE, None)
        run = BatchRun(batch, logs, 0, pool, progress, Stop())
        warm = round(_WARM_UP * len(logs))
        stages = [_Usage.now()]
        for tries in (range(warm), range(warm, len(logs))):
            drive(map(Try, tries), pool, run.judge, run.stop.is_asked, run.look)
            stages.append(_Usage.now())
        done, slots = progress.tally.done, pool.slots()
    _, begin, end = stages
    count = len(logs) - warm
    return {
        "logs": len(logs),
        "done": done,
        "slots": slots,
        "slot_ms": 1e3 * slots * (end.wall_s - begin.wall_s) / count,
        "driver_ms": 1e3 * (end.driver_s - begin.driver_s) / count,
        "ray_ms": 1e3 * (end.ray_s - begin.ray_s) / count,
        "memory_mb": begin.memory_mb,
        "last_memory_mb": end.memory_mb,
    }


class _Usage(msgspec.Struct, frozen=True):
    """Time and memory that this process and Ray have used so far."""

    wall_s: float
    driver_s: float
    ray_s: float
    memory_mb: float  # of this process (USS)

    @classmethod
    def now(cls) -> "_Usage":
        own = psutil.Process()
        used = [process.cpu_times() for process in own.children(recursive=True)]
        ray_s = sum(u.user + u.system + u.children_user + u.children_system for u in used)
        memory_mb = own.memory_full_info().uss / 1e6
        return cls(time.monotonic(), time.process_time(), ray_s, memory_mb)


def _echo(arguments: Sequence[str], index: int, board: Any) -> TaskResult:
    """The task of a log: prints its arguments."""
    return perform_command(["echo", *arguments], index, board)


def _result(batch: Batch, log: Log) -> str:
    """A done log as the line that `hsslam-batch work --json` prints."""
    outcome = Outcome(
        id=log.id,
        name=log.name,
        configuration=batch.about.configuration,
        attempt=1,
        kind="done",
        node=platform.node(),
        frames=log.frames,
    )
    return msgspec.json.encode(Ended(outcome)).decode()


if __name__ == "__main__":
    main()
