"""Commits the results of a log: move the run folder to its place, then write the row that makes it valid."""

import contextlib
import fcntl
import os
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec

from hsslam_batch.attempt import store_results
from hsslam_batch.attempt.outcome import Outcome, encoded
from hsslam_batch.attempt.whole_run import expect_whole
from hsslam_batch.plan.batch import Batch
from hsslam_batch.plan.log import Log
from hsslam_node.durable_file import sync_folder, write_durably
from hsslam_services.log.parts import part_number

_LOCK = ".commit.lock"
_OLDER = "older"  # beside the run folder, until it is removed


def commit(batch: Batch, outcome: Outcome, run_dir: Path) -> None:
    """Make a run folder the result of its log; keep the result of an earlier attempt if there is one.

    Results under another configuration count until the run folder takes their place.

    Raises:
        OSError: the folder of the batch cannot be written, or the run folder is not there whole.
    """
    if batch.store is not None:
        store_results.commit(batch, batch.store, outcome, run_dir)
        return
    target = batch.run_dir(outcome.id)
    with _alone(batch):
        if _is_done(batch, outcome):
            return
        expect_whole(run_dir)
        target.parent.mkdir(exist_ok=True)
        older = run_dir.with_name(_OLDER)
        if target.exists():
            target.rename(older)  # in one step: a folder removed in part is no result
        try:
            run_dir.rename(target)
        except OSError:
            if older.exists():
                older.rename(target)
            raise
        sync_folder(target.parent)
        _link_recordings(batch, outcome.id)
        write_durably(batch.done_file(outcome.id), encoded(outcome))
        os.utime(target.parent)  # a table that was made before the row is an old one
        batch.failed_file(outcome.id).unlink(missing_ok=True)
        shutil.rmtree(older, ignore_errors=True)


def settle_failed(batch: Batch, outcome: Outcome) -> None:
    """Write down why a log has no result; its results under an earlier configuration stay.

    Raises:
        OSError: the folder of the batch cannot be written.
    """
    if batch.store is not None:
        store_results.settle_failed(batch, batch.store, outcome)
        return
    with _alone(batch):
        if _is_done(batch, outcome):
            return
        path = batch.failed_file(outcome.id)
        path.parent.mkdir(exist_ok=True)
        write_durably(path, encoded(outcome))


def settle_files(batch: Batch, logs: Sequence[Log]) -> None:
    """Make the folder of recordings hold those of the logs that are done, and no others; in a store remove
    what attempts have uploaded that are not the result of their log.

    No attempt may run at the same time.

    Raises:
        OSError: the folder or the store of the batch cannot be written.
    """
    if batch.store is not None:
        store_results.remove_other_uploads(batch, batch.store, [log.id for log in logs])
        return
    done = {log_id for log_id, row in all_settled(batch, logs).items() if row.is_done}
    linked = {path.stem for path in batch.rrd_files()}
    for log_id in linked - done:
        _unlink_recordings(batch, log_id)
    for log_id in done - linked:
        _link_recordings(batch, log_id)


def settled(batch: Batch, log_id: str) -> Outcome | None:
    """The row of a log under the current configuration; None if it has none.

    Raises:
        OSError: the store of the batch fails, or a row is there but cannot be read.
    """
    if batch.store is not None:
        return store_results.settled(batch, batch.store, [log_id]).get(log_id)
    for path in (batch.done_file(log_id), batch.failed_file(log_id)):
        with contextlib.suppress(FileNotFoundError, NotADirectoryError, msgspec.MsgspecError):
            outcome = msgspec.json.decode(path.read_bytes(), type=Outcome)
            if outcome.configuration == batch.about.configuration:
                return outcome
    return None


def all_settled(batch: Batch, logs: Sequence[Log]) -> dict[str, Outcome]:
    """The rows of all logs that have one, by id.

    Raises:
        UserError: the store of the batch fails.
    """
    ids = [log.id for log in logs]
    with batch.expect_writable():
        if batch.store is not None:
            return store_results.all_settled(batch, batch.store, ids)
        return {log_id: row for log_id in ids if (row := settled(batch, log_id))}


@contextlib.contextmanager
def _alone(batch: Batch) -> Iterator[None]:
    """Wait for other attempts that commit: a log may have two, if its node was unreachable for a while.

    A file system without locks, such as some shared ones, has no such protection.
    """
    with (batch.out / _LOCK).open("w") as file:
        with contextlib.suppress(OSError):
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _is_done(batch: Batch, outcome: Outcome) -> bool:
    found = settled(batch, outcome.id)
    return found is not None and found.is_done


def _unlink_recordings(batch: Batch, log_id: str) -> None:
    for stale in batch.rrd_files(log_id):
        stale.unlink()


def _link_recordings(batch: Batch, log_id: str) -> None:
    """Link the parts of a recording, each into a folder with the same part of other logs; copy them if the
    file system has no hard links. The oldest part that is left (`--log-keep`) counts as the first."""
    _unlink_recordings(batch, log_id)
    recordings = batch.run_dir(log_id).glob("run*.rrd")
    in_order = sorted(recordings, key=lambda path: part_number(path.with_suffix(".mcap")))
    for part, recording in enumerate(in_order):
        link = batch.rrd_file(log_id, part)
        link.parent.mkdir(exist_ok=True)
        try:
            os.link(recording, link)
        except OSError:
            shutil.copyfile(recording, link)
