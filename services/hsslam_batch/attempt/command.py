"""`hsslam-batch work`: runs one log in one process group, for Ray's tasks and for other schedulers."""

import os
import sys
from collections.abc import Sequence

import msgspec

from hsslam_batch.attempt.commit import settled
from hsslam_batch.attempt.look_up import look_up
from hsslam_batch.attempt.outcome import ENDS, Ended, Frames, Outcome, Refused, Unavailable
from hsslam_batch.attempt.serve_log import CancelledError, Terms, serve_log
from hsslam_batch.attempt.watched_process import Limits
from hsslam_batch.options import WorkOptions
from hsslam_batch.plan.batch import Batch, OtherPlanError, UnavailableError, folder_of
from hsslam_batch.plan.log import Log, read_manifest
from hsslam_batch.plan.read_batch import read_batch
from hsslam_node.errors import UserError
from hsslam_node.kernels.cache_folder import writable_kernel_cache
from hsslam_services.commands.cli import parse_options
from hsslam_services.run.stop_signals import hear_stop_signals

_FAILED = 3


def work_command(args: Sequence[str]) -> int:
    """Make one attempt at a log and commit it; returns the exit code.

    Raises:
        UserError: the folder has no batch, the log does not exist, or code or log differ from the plan.
    """
    options = parse_options(WorkOptions, "hsslam-batch work", args)
    try:
        return _work(options)
    except UnavailableError as error:  # not bad input: another attempt or machine may work
        if options.json:
            print(msgspec.json.encode(Unavailable(str(error))).decode(), flush=True)
        print(f"error: {error}", file=sys.stderr)
        return _FAILED
    except OtherPlanError as error:  # the log has not failed
        if options.json:
            print(msgspec.json.encode(Refused(str(error))).decode(), flush=True)
        raise


def _work(options: WorkOptions) -> int:
    before = None
    if is_remote := bool(folder_of(options.out)[1]):
        batch, before = look_up(options.out, options.index, options.patience_s)
    else:
        batch = read_batch(options.out, options.patience_s)
    batch.expect_same_code()
    log = _planned(batch, options)
    if not is_remote:
        with batch.expect_writable():
            before = settled(batch, log.id)
    if before is not None and before.is_done:
        _report(options.json, before)
        return 0
    _expect_kernel_cache()
    cancel_fds = [_stop_signal_fd()] + ([sys.stdin.fileno()] if options.tied else [])
    limits = Limits(options.timeout_s, options.memory_gb)
    terms = Terms(options.attempt, options.retries, limits, options.scratch, options.fetch_gb)
    last = 0

    def report_frames(frames: int) -> None:
        nonlocal last
        if options.json and frames != last:
            last = frames
            print(msgspec.json.encode(Frames(frames)).decode(), flush=True)

    try:
        with batch.expect_writable():
            outcome = serve_log(batch, log, terms, cancel_fds, report_frames)
    except CancelledError:
        raise KeyboardInterrupt from None
    _report(options.json, outcome)
    return ENDS.get(outcome.kind, _FAILED)


def _expect_kernel_cache() -> None:
    """Raises:
    UnavailableError: this machine has no folder for compiled kernels, without which no run starts.
    """
    try:
        writable_kernel_cache()
    except UserError as error:
        raise UnavailableError(str(error)) from None


def _planned(batch: Batch, options: WorkOptions) -> Log:
    """The log that the options name."""
    logs = read_manifest(batch.out)
    row = logs[options.index : options.index + 1]
    if options.id and [log.id for log in row] != [options.id]:
        raise OtherPlanError(
            f"--id {options.id}: {batch.place} has another log in row {options.index}: expected the "
            "plan with which the run began"
        )
    if not row:
        raise UserError(f"--index {options.index}: expected 0 to {len(logs) - 1}")
    return row[0]


def _stop_signal_fd() -> int:
    """A file descriptor that becomes readable when this process gets a stop signal."""
    readable, writable = os.pipe()
    os.set_blocking(writable, False)
    hear_stop_signals(lambda _: os.write(writable, b"."))
    return readable


def _report(as_json: bool, outcome: Outcome) -> None:
    if as_json:
        print(msgspec.json.encode(Ended(outcome)).decode(), flush=True)
    elif outcome.is_done:
        print(f"{outcome.name}: done, {outcome.tracked} of {outcome.frames} frames tracked")
    else:
        print(outcome.failure, file=sys.stderr)
