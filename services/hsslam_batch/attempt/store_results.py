"""Commits results to a store: each attempt has its own folder, and the first to create the row is the result.

A store cannot rename, so the files of an attempt go to `runs/ID/ATTEMPT.TOKEN/`. The attempt then creates
`runs/ID/_DONE.json`, which names that folder. Only one attempt can create it, so files of two never mix. No
attempt removes the files of another one, which may become the result: `run` does so once none runs.
"""

import contextlib
import itertools
import secrets
from collections.abc import Collection, Iterable
from pathlib import Path

import msgspec

from hsslam_batch.attempt.outcome import Outcome, encoded
from hsslam_batch.attempt.whole_run import expect_whole
from hsslam_batch.plan.batch import Batch
from hsslam_batch.plan.store import Store

_TOKEN_BYTES = 4


class StoredOutcome(Outcome, frozen=True, kw_only=True):
    """A row in a store: the folder of the attempt, below that of the log, and all files in it."""

    folder: str
    files: tuple[str, ...]


def commit(batch: Batch, store: Store, outcome: Outcome, run_dir: Path) -> None:
    """Upload a run folder and make it the result of its log, unless another attempt has one.

    Results under another configuration count until the upload is complete.

    Raises:
        OSError: the store fails, or the run folder is not there whole; the log then has no result.
    """
    if _is_done(batch, store, outcome):
        return
    expect_whole(run_dir)
    base, row_name = batch.name(batch.run_dir(outcome.id)), batch.name(batch.done_file(outcome.id))
    folder = f"{outcome.attempt}.{secrets.token_hex(_TOKEN_BYTES)}"
    files = store.upload(run_dir, f"{base}/{folder}")
    found = msgspec.structs.asdict(outcome) | {"folder": folder, "files": tuple(files)}
    row = encoded(StoredOutcome(**found))
    if _is_late(batch, store, outcome) or not store.create(row_name, row):
        store.remove(f"{base}/{folder}/{name}" for name in files)
        return
    store.remove([batch.name(batch.failed_file(outcome.id))])


def remove_other_uploads(batch: Batch, store: Store, ids: Collection[str]) -> None:
    """Remove the uploads of logs that are done, except those of the results. No attempt may run meanwhile.

    It reads the rows of those logs alone that have uploads of several attempts.

    Raises:
        OSError: the store fails.
    """
    base = batch.name(batch.run_dir("any").parent)
    uploads: dict[str, dict[str, list[str]]] = {log_id: {} for log_id in ids}
    for name in store.sizes(base):
        log_id, _, below = name.partition("/")
        folder, is_upload, _ = below.partition("/")
        if log_id in uploads and is_upload:
            uploads[log_id].setdefault(folder, []).append(f"{base}/{name}")
    several = [log_id for log_id, folders in uploads.items() if len(folders) > 1]
    for log_id, row in settled(batch, store, several).items():
        if isinstance(row, StoredOutcome):
            others = (files for folder, files in uploads[log_id].items() if folder != row.folder)
            store.remove(itertools.chain.from_iterable(others))


def settle_failed(batch: Batch, store: Store, outcome: Outcome) -> None:
    """Write down why a log has no result, unless an attempt has one. Removes nothing.

    Raises:
        OSError: the store fails.
    """
    if not _is_done(batch, store, outcome):
        store.write(batch.name(batch.failed_file(outcome.id)), encoded(outcome))


def settled(batch: Batch, store: Store, ids: Collection[str]) -> dict[str, Outcome]:
    """The rows of logs under the current configuration, by id; logs without a row are left out.

    Raises:
        OSError: the store fails.
    """
    return _settled(batch, store, ids, ids)


def all_settled(batch: Batch, store: Store, ids: Collection[str]) -> dict[str, Outcome]:
    """The same for all logs of a batch: two listings say which of them can have a row, and it reads no other.

    Raises:
        OSError: the store fails.
    """
    begun = {*store.folders(batch.name(batch.run_dir("any").parent))}
    names = store.sizes(batch.name(batch.failed_file("any").parent))
    failed = {name.removesuffix(".json") for name in names}
    return _settled(batch, store, begun.intersection(ids), failed.intersection(ids))


def _settled(
    batch: Batch, store: Store, begun: Iterable[str], failed: Iterable[str]
) -> dict[str, Outcome]:
    """Read the results in the run folders of the logs `begun`, and the failures of the logs `failed` that
    have no result."""
    done_files = {batch.name(batch.done_file(log_id)): log_id for log_id in begun}
    found = _rows(batch, store, done_files, StoredOutcome)
    failed_files = {
        batch.name(batch.failed_file(log_id)): log_id for log_id in failed if log_id not in found
    }
    return _rows(batch, store, failed_files, Outcome) | found


def _rows(
    batch: Batch, store: Store, names: dict[str, str], kind: type[Outcome]
) -> dict[str, Outcome]:
    found = store.read_all(names).items()
    return {names[name]: row for name, data in found if (row := _row(batch, data, kind))}


def _row(batch: Batch, data: bytes, kind: type[Outcome]) -> Outcome | None:
    """The row in a file; None if it is of another configuration or damaged."""
    with contextlib.suppress(msgspec.MsgspecError):
        row = msgspec.json.decode(data, type=kind)
        if row.configuration == batch.about.configuration:
            return row
    return None


def _is_done(batch: Batch, store: Store, outcome: Outcome) -> bool:
    found = settled(batch, store, [outcome.id]).get(outcome.id)
    return found is not None and found.is_done


def _is_late(batch: Batch, store: Store, outcome: Outcome) -> bool:
    """Whether the log is done by now; removes the row of a result under another configuration."""
    name = batch.name(batch.done_file(outcome.id))
    for data in store.read_all([name]).values():
        if _row(batch, data, StoredOutcome):
            return True
        store.remove([name])
    return False
