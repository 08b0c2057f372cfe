"""`runs.parquet`: a row a log with its outcome and the paths of its results, for pandas, DuckDB, Polars."""

import io
import os
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from hsslam_batch.attempt.commit import all_settled
from hsslam_batch.attempt.outcome import Outcome
from hsslam_batch.attempt.store_results import StoredOutcome
from hsslam_batch.plan.batch import MANIFEST, Batch
from hsslam_batch.plan.log import Log
from hsslam_batch.plan.parquet_rows import read_rows, write_rows
from hsslam_node.errors import UserError
from hsslam_services.log.parts import is_part, parts

RUNS = "runs.parquet"
_LOG = "run.mcap"  # of one part
_MAGIC = b"PAR1"  # a Parquet file begins and ends with it
_REQUIRED = ("id", "name", "configuration", "kind")
_ARTEFACTS = {  # column: file in the run folder
    "trajectory": "trajectory.txt",
    "keyframes_file": "keyframes.txt",
    "mesh": "mesh.ply",
    "map": "map.safetensors",
}


class NoTableError(UserError):
    """The table of a batch is missing, not readable or another table."""


def write_runs(
    batch: Batch, logs: Sequence[Log], settled: Mapping[str, Outcome] | None = None
) -> Path:
    """Write the table of all logs that are done or failed; paths are relative to the folder of the batch.

    A log that is left, as `status` counts it, has no row. `settled`: `all_settled` (None: reads it).

    Raises:
        OSError: the folder or the store is not writable.
        UserError: the store is not readable.
    """
    newest_ns = _newest_ns(batch)
    if settled is None:
        settled = all_settled(batch, logs)
    _write(batch, _rows(batch, logs, settled), newest_ns)
    return batch.out / RUNS


def renew_runs(batch: Batch, logs: Sequence[Log]) -> list[dict[str, Any]]:
    """Write the table with `known_rows`, and return them. A table that is not readable is replaced.

    Raises:
        OSError: the folder or the store is not writable.
        UserError: the store is not readable.
    """
    newest_ns = _newest_ns(batch)
    try:
        rows = known_rows(batch, logs)
    except NoTableError:
        rows = _rows(batch, logs, all_settled(batch, logs))
    _write(batch, rows, newest_ns)
    return rows


def known_rows(batch: Batch, logs: Sequence[Log]) -> list[dict[str, Any]]:
    """The rows of all logs that are done or failed; writes nothing.

    A log whose results were removed keeps its row of the table, until it has a further attempt.

    Raises:
        UserError: the table or the store is not readable.
    """
    current = batch.about.configuration
    written = [row for row in _written(batch) if row["configuration"] == current]
    settled = all_settled(batch, logs)
    rows = {row["id"]: row for row in written if row["id"] not in settled}
    rows |= {row["id"]: row for row in _rows(batch, logs, settled)}
    return [rows[log.id] for log in logs if log.id in rows]


def is_current(batch: Batch) -> bool:
    """Whether the table of a folder is whole, and plan and results are those of which it was made."""
    try:
        written_ns = (batch.out / RUNS).stat().st_mtime_ns
        is_whole = (batch.out / RUNS).read_bytes().endswith(_MAGIC)  # PyArrow imports pandas
    except OSError:
        return False
    return is_whole and _newest_ns(batch) <= written_ns


def read_runs(out: Path) -> list[dict[str, Any]]:
    """The rows of the table in the folder of a batch; None in columns that an earlier version did not write.

    Raises:
        NoTableError: the table is missing, not readable or another one.
    """
    return _read(out / RUNS, out / RUNS)


def _newest_ns(batch: Batch) -> int:
    """When plan or results of a folder last changed; each commit sets the time of one of these folders."""
    changed = (batch.out / MANIFEST, batch.run_dir("any").parent, batch.failed_file("any").parent)
    return max((path.stat().st_mtime_ns for path in changed if path.exists()), default=0)


def _write(batch: Batch, rows: Sequence[dict[str, Any]], newest_ns: int) -> None:
    """Write the table, as of the time `newest_ns`: a result that has come since makes it an old one."""
    write_rows(batch.out / RUNS, rows, _columns())
    os.utime(batch.out / RUNS, ns=(newest_ns, newest_ns))
    batch.publish(RUNS)


def _read(source: Path | io.BytesIO, name: object) -> list[dict[str, Any]]:
    try:
        rows = read_rows(source)
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise NoTableError(f"{name}: {reason}: expected the table of a batch") from None
    for column in _REQUIRED:
        if rows and column not in rows[0]:
            raise NoTableError(f"{name}: has no column {column!r}: expected the table of a batch")
    return [{**dict.fromkeys(_columns()), **row} for row in rows]


def _written(batch: Batch) -> list[dict[str, Any]]:
    """The rows of the existing table; none without a table."""
    if batch.store is None:
        return read_runs(batch.out) if (batch.out / RUNS).exists() else []
    with batch.expect_writable():
        found = batch.store.read_all([RUNS])
    return _read(io.BytesIO(found[RUNS]), f"{batch.url}/{RUNS}") if found else []


def _rows(
    batch: Batch, logs: Sequence[Log], settled: Mapping[str, Outcome]
) -> list[dict[str, Any]]:
    over = {log_id: outcome for log_id, outcome in settled.items() if not outcome.is_left}
    return [_row(batch, log, over[log.id]) for log in logs if log.id in over]


def _row(batch: Batch, log: Log, outcome: Outcome) -> dict[str, Any]:
    return {
        **msgspec.structs.asdict(outcome),
        "index": log.index,
        "source": log.source,
        "log_bytes": log.nbytes,
        **_files(batch, log, outcome),
    }


def _files(batch: Batch, log: Log, outcome: Outcome) -> dict[str, str | None]:
    """Paths of the results of a log, relative to the folder or the URL of the batch; None: no such file."""
    run_dir = batch.run_dir(log.id)
    if isinstance(outcome, StoredOutcome):
        run_dir /= outcome.folder
        there = {run_dir / file for file in outcome.files}
        paths = {name: run_dir / file for name, file in (*_ARTEFACTS.items(), ("rrd", "run.rrd"))}
        found = {name: path if path in there else None for name, path in paths.items()}
        found["log"] = _log_of(run_dir, [file for file in outcome.files if is_part(file)])
        return {name: batch.name(path) if path else None for name, path in found.items()}
    if not outcome.is_done:
        return dict.fromkeys((*_ARTEFACTS, "log", "rrd"))
    paths = {name: run_dir / file for name, file in _ARTEFACTS.items()}
    paths["rrd"] = batch.rrd_file(log.id)
    found = {name: path if path.exists() else None for name, path in paths.items()}
    found["log"] = _log_of(run_dir, [part.name for part in parts(run_dir)])
    return {name: batch.name(path) if path else None for name, path in found.items()}


def _log_of(run_dir: Path, parts_of_log: Sequence[str]) -> Path | None:
    """The file of a log of one part, else the run folder, which readers take as the whole log."""
    if list(parts_of_log) == [_LOG]:
        return run_dir / _LOG
    return run_dir if parts_of_log else None


def _columns() -> dict[str, type]:
    of_outcome = {field.name: _plain(field.type) for field in msgspec.structs.fields(Outcome)}
    of_log = {"index": int, "source": str, "log_bytes": int}
    return {**of_outcome, **of_log, **dict.fromkeys((*_ARTEFACTS, "log", "rrd"), str)}


def _plain(kind: Any) -> type:
    """The column type of a field: int, float or str; str for a Literal."""
    parts = (kind, *typing.get_args(kind))
    return next((part for part in parts if part in (int, float, str)), str)
