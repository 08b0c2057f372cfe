"""`hsslam-batch run`: runs all logs that are left as tasks of Ray."""

import contextlib
import signal
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from hsslam_batch.attempt.commit import all_settled, settle_files
from hsslam_batch.attempt.outcome import Outcome, may_try_again
from hsslam_batch.cluster.batch_run import BatchRun, Stop, work_words
from hsslam_batch.cluster.drive import Try, drive
from hsslam_batch.cluster.task import perform
from hsslam_batch.cluster.work_folder import clear_work
from hsslam_batch.options import RunOptions
from hsslam_batch.plan.batch import Batch, OtherPlanError, UnavailableError
from hsslam_batch.plan.lock import alone
from hsslam_batch.plan.log import Log, read_manifest
from hsslam_batch.plan.read_batch import read_batch
from hsslam_batch.results.metrics import MetricsFile
from hsslam_batch.results.progress import BatchProgress
from hsslam_batch.results.runs_table import is_current, write_runs
from hsslam_batch.results.tally import Tally
from hsslam_services.commands.cli import parse_options, print_at_end
from hsslam_services.run.resilient_stream import say_at_end
from hsslam_services.run.stop_signals import hear_stop_signals

_RAY_MESSAGES = "ray.log"
_INTERRUPTED, _FAILED = 1, 3


def run_command(args: Sequence[str]) -> int:
    """Run all logs that are left; returns the exit code, 1 if the folder or the store of the batch fails.

    Raises:
        UserError: the folder has no batch, the code differs from the plan, no Ray at the address, or another
            run or plan of this batch is running.
    """
    options = parse_options(RunOptions, "hsslam-batch run", args)
    try:
        return _run_all(options)
    except UnavailableError as error:  # not bad input: the same command may work later
        say_at_end(f"error: {error}")
        return _INTERRUPTED


def _run_all(options: RunOptions) -> int:
    batch = read_batch(options.out)
    logs = read_manifest(batch.out)
    rows = all_settled(batch, logs)
    found = {log.index: rows.get(log.id) for log in logs}
    waiting = waiting_tries(found, options)
    if not waiting:
        with _owned(batch, logs):
            settle_files(batch, logs)
            if batch.url:
                write_runs(batch, logs, rows)
            elif not is_current(batch):  # `work` may have run a log since
                write_runs(batch, logs)
        tally = Tally(logs, filter(None, found.values()))
        _write_metrics(options.metrics_file, batch, tally)
        print_at_end(tally.line())
        return _FAILED if any(o and not o.is_done for o in found.values()) else 0
    batch.expect_same_code()
    open_logs = {one.index for one in waiting}
    over = [outcome for index, outcome in found.items() if outcome and index not in open_logs]
    tally = Tally(logs, over)
    with _owned(batch, logs):
        clear_work(batch, but_fetched=True)
        stopped = _run(batch, logs, waiting, tally, options)
        settle_files(batch, logs)
        write_runs(batch, logs)
        if not tally.left:
            clear_work(batch)
    print_at_end(tally.line())
    if tally.left:
        if not stopped:
            say_at_end(f"error: {tally.left} logs are left: expected none")
        return _INTERRUPTED
    return _FAILED if tally.failed else 0


def _write_metrics(path: Path | None, batch: Batch, tally: Tally) -> None:
    """Write the counts of a batch that has nothing left to run; a warning if that fails, as during a run."""
    try:
        MetricsFile(path, batch.about).write(tally, running=0)
    except OSError as error:
        say_at_end(f"warning: {path}: {error.strerror or error}: not written")


def waiting_tries(found: Mapping[int, Outcome | None], options: RunOptions) -> list[Try]:
    """The logs that are left, each with the number of its next attempt, in the order of the manifest.

    Those that were `unavailable` come last, so that they stop no others; of them the one that was tried last
    comes last.
    """

    def tried_ns(one: Try) -> int:
        outcome = found[one.index]
        return outcome.started_ns if outcome and outcome.kind == "unavailable" else -1

    return sorted(_left(found, options), key=tried_ns)


def _left(found: Mapping[int, Outcome | None], options: RunOptions) -> Iterator[Try]:
    """The logs that are left, in the order of the manifest."""
    for index, outcome in found.items():
        if outcome is None or outcome.kind == "unavailable":
            yield Try(index)  # a store that failed says nothing about the log
        elif outcome.is_done:
            continue
        elif options.failed:
            yield Try(index)
        elif outcome.is_left or may_try_again(outcome, options.retries):
            yield Try(index, outcome.attempt + 1)


def _run(
    batch: Batch, logs: list[Log], waiting: list[Try], tally: Tally, options: RunOptions
) -> bool:
    """Run all waiting attempts; returns whether the batch was stopped before the end."""
    from hsslam_batch.cluster.connect import connected  # Ray takes 1 s to import, may be missing
    from hsslam_batch.cluster.ray_pool import RayPool, Share

    with (
        _stopping() as stop,
        connected(options.address, batch.out / _RAY_MESSAGES),
        BatchProgress(batch, tally, options.metrics_file) as progress,
    ):
        _hear(stop)  # Ray has replaced the handlers
        share = Share(options.cpus, options.memory_gb)
        words = partial(work_words, batch, logs, options)
        pool = RayPool(perform, words, share, options.parallel)
        run = BatchRun(batch, logs, options.retries, pool, progress, stop)
        drive(waiting, pool, run.judge, stop.is_asked, run.look)
        return stop.is_asked()


@contextlib.contextmanager
def _stopping() -> Iterator[Stop]:
    """In the block the first stop signal asks the batch to stop, the second raises KeyboardInterrupt."""
    stop = Stop()
    before = _hear(stop)
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _hear(stop: Stop) -> Mapping[signal.Signals, Any]:
    """Ask the batch to stop at a stop signal; returns the former handlers."""

    def hear(count: int) -> None:
        if count > 1:
            raise KeyboardInterrupt
        stop.ask()

    return hear_stop_signals(hear)


@contextlib.contextmanager
def _owned(batch: Batch, logs: list[Log]) -> Iterator[None]:
    """Lock the batch in the block; its plan is still the one that was read.

    Raises:
        UserError: another process holds the lock, the plan has changed, or the folder is not writable.
    """
    with batch.expect_writable(), alone(batch.out, batch.place):
        if (read_batch(batch.place), read_manifest(batch.out)) != (batch, logs):
            raise OtherPlanError(
                f"{batch.place}: the plan has just changed: expected the same command again"
            )
        yield
