"""What it costs to schedule a log whose run takes no time, as JSON on stdout: a process of its own.

`python -m hsslam_bench.batch.scheduling [--logs N]` plans logs of one frame and does what `hsslam-batch run`
does with them, on a Ray of its own on this machine, but the command of each attempt is `echo`: it prints a
result at once. So the time that an attempt holds its slot is what Ray, worker, process and driver take.
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

_WARM_UP = 0.1  # of the logs, after which memory and time count
_SHARE = Share(cpus=1.0, memory_gb=0.1)


def main() -> None:
    report_on_many("batch.scheduling", __doc__, scheduling)


def scheduling(batch: Batch) -> dict[str, float]:
    """Schedule all logs of a batch, and tell what it took.

    `slot_ms`: time of a slot for each log. `driver_ms`, `ray_ms`: core time a log of this process, and of all
    of Ray's with the commands. `memory_mb`: memory of this process after a tenth of the logs and at the end.
    """
    logs = read_manifest(batch.out)
    with connected("local"), BatchProgress(batch, Tally(logs, [])) as progress:
        pool = RayPool(_echo, lambda one: [_result(batch, logs[one.index])], _SHARE, None)
        run = BatchRun(batch, logs, 0, pool, progress, Stop())
        warm = round(_WARM_UP * len(logs))
        stages = [_Taken.now()]
        for tries in (range(warm), range(warm, len(logs))):
            drive(map(Try, tries), pool, run.judge, run.stop.is_asked, run.look)
            stages.append(_Taken.now())
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


class _Taken(msgspec.Struct, frozen=True):
    """What this process and Ray have taken so far."""

    wall_s: float
    driver_s: float
    ray_s: float
    memory_mb: float  # of this process (USS)

    @classmethod
    def now(cls) -> "_Taken":
        own = psutil.Process()
        used = [process.cpu_times() for process in own.children(recursive=True)]
        ray_s = sum(u.user + u.system + u.children_user + u.children_system for u in used)
        memory_mb = own.memory_full_info().uss / 1e6
        return cls(time.monotonic(), time.process_time(), ray_s, memory_mb)


def _echo(arguments: Sequence[str], index: int, board: Any) -> TaskResult:
    """The task of a log: prints its arguments."""
    return perform_command(["echo", *arguments], index, board)


def _result(batch: Batch, log: Log) -> str:
    """As `hsslam-batch work --json` prints it."""
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
