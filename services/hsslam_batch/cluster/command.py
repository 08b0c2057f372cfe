"""`hsslam-batch run`: all logs that are left, as tasks of Ray."""

import contextlib
import fcntl
import shutil
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

from hsslam_batch.attempt.commit import settle_failed, settled
from hsslam_batch.attempt.outcome import Outcome, may_try_again
from hsslam_batch.cluster.drive import Try, drive
from hsslam_batch.cluster.task import TaskResult, perform
from hsslam_batch.options import RunOptions
from hsslam_batch.plan.batch import Batch, read_batch
from hsslam_batch.plan.log import Log, read_manifest
from hsslam_batch.results.progress import BatchProgress
from hsslam_batch.results.runs_table import RUNS, write_runs
from hsslam_batch.results.tally import Tally
from hsslam_node.errors import UserError
from hsslam_services.commands.cli import parse_options

_LOCK = ".lock"
_INTERRUPTED, _FAILED = 1, 3


def run_command(args: list[str]) -> int:
    """Run what is left; its exit code.

    Raises:
        UserError: no batch there, other code than it was planned with, no Ray at the address, another run
            of this batch goes on, or the folder cannot be written.
    """
    options = parse_options(RunOptions, "hsslam-batch run", args)
    batch = read_batch(options.out)
    logs = read_manifest(batch.out)
    found = {log.index: settled(batch, log.id) for log in logs}
    waiting = list(waiting_tries(found, options))
    if not waiting:
        if not (batch.out / RUNS).exists():
            write_runs(batch, logs)
        print(Tally(logs, filter(None, found.values())).line())
        return _FAILED if any(o and not o.is_done for o in found.values()) else 0
    batch.expect_same_code()
    open_logs = {one.index for one in waiting}
    over = [outcome for index, outcome in found.items() if outcome and index not in open_logs]
    tally = Tally(logs, over)
    try:
        with _alone(batch):
            shutil.rmtree(batch.work, ignore_errors=True)  # of a run that was killed
            stopped = _run(batch, logs, waiting, tally, options)
            write_runs(batch, logs)
            if not tally.left:
                shutil.rmtree(batch.work, ignore_errors=True)
    except OSError as error:
        raise UserError(
            f"{batch.out}: {error.strerror}: expected a folder that can be written"
        ) from None
    print(tally.line())
    if stopped and tally.left:
        return _INTERRUPTED
    return _FAILED if tally.failed else 0


def waiting_tries(found: dict[int, Outcome | None], options: RunOptions) -> Iterator[Try]:
    """The logs that are left, in the order of the manifest, each with the number of its next attempt."""
    for index, outcome in found.items():
        if outcome is None or (options.failed and not outcome.is_done):
            yield Try(index)
        elif not outcome.is_done and may_try_again(outcome, options.retries):
            yield Try(index, outcome.attempt + 1)


def _run(
    batch: Batch, logs: list[Log], waiting: list[Try], tally: Tally, options: RunOptions
) -> bool:
    """Run all that wait; whether it was stopped before the end."""
    from hsslam_batch.cluster.connect import connected  # Ray takes a second, and may be missing
    from hsslam_batch.cluster.ray_pool import RayPool, Share

    def arguments(one: Try) -> list[str]:
        words = [str(batch.out), "--index", str(one.index), "--attempt", str(one.attempt)]
        limit = [] if options.timeout_s is None else ["--timeout", str(options.timeout_s)]
        scratch = [] if options.scratch is None else ["--scratch", str(options.scratch)]
        fetch = ["--fetch-gb", str(options.fetch_gb), *scratch]
        return [*words, "--memory", str(options.memory_gb), *limit, *fetch]

    with connected(options.address), BatchProgress(batch, tally) as progress:
        share = Share(options.cpus, options.memory_gb)
        pool = RayPool(perform, arguments, share, options.parallel)
        with _stopping(
            lambda: (pool.close(), progress.say("running logs end; Ctrl-C ends them"))
        ) as stop:

            def judge(one: Try, result: TaskResult) -> Try | None:
                if not result.is_begun:
                    return None
                log = logs[one.index]
                outcome = result.outcome or _without_result(batch, log, one, result)
                if may_try_again(outcome, options.retries):
                    progress.tried_again(outcome)
                    return Try(one.index, one.attempt + 1, result.node_id)
                progress.settled(outcome)
                return None

            def look() -> None:
                running = pool.running().items()
                progress.look({logs[index].id: now.frames for index, now in running})

            drive(waiting, pool, judge, lambda: stop.is_set, look)
            return stop.is_set


class _Stop:
    is_set = False


@contextlib.contextmanager
def _stopping(on_first) -> Iterator[_Stop]:
    """In the block the first SIGINT or SIGTERM sets the flag, the second is a KeyboardInterrupt."""
    stop = _Stop()

    def hear(_number: int, _frame: FrameType | None) -> None:
        if stop.is_set:
            raise KeyboardInterrupt
        stop.is_set = True
        on_first()

    before = {number: signal.signal(number, hear) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _without_result(batch: Batch, log: Log, one: Try, result: TaskResult) -> Outcome:
    """The row of an attempt that left none itself."""
    outcome = Outcome(
        id=log.id,
        name=log.name,
        configuration=batch.about.configuration,
        attempt=one.attempt,
        kind="lost" if result.is_lost else "crash",
        reason=result.trouble,
        code=batch.about.code,
        started_ns=time.time_ns(),
    )
    settle_failed(batch, outcome)
    return settled(batch, log.id) or outcome  # it may have committed just before it died


@contextlib.contextmanager
def _alone(batch: Batch) -> Iterator[None]:
    """Own the batch in the block.

    Raises:
        UserError: another process does.
    """
    with Path(batch.out / _LOCK).open("wb") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UserError(f"{batch.out}: another hsslam-batch run is at work on it") from None
        except OSError:
            pass  # a file system without locks
        yield
