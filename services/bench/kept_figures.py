"""The newest figure of every row, kept beside the documents as result files without their runs."""

from collections.abc import Sequence
from pathlib import Path

import msgspec

from hsslam_node.errors import UserError
from hsslam_node.services.bench.newest_rows import NewestRows, read_for_documents
from hsslam_node.services.bench.report import write_report


def keep(folder: Path, results: Sequence[Path]) -> list[Path]:
    """Take in the rows of `results`; what they replace goes, and what the catalogue no longer has.

    Returns the files that `folder` then has, oldest first: one for each benchmark, named by its time.

    Raises:
        UserError: not a result file, or one that did not follow the protocol; `folder` cannot be written.
    """
    before = sorted(folder.glob("*.json"))
    reports = [read_for_documents(path) for path in (*before, *results)]
    newest = NewestRows.of(sorted(reports, key=lambda found: found.time))
    after: list[Path] = []
    for found, rows in newest.by_report(newest.rows.values()):
        after.append(folder / f"{found.time.replace(':', '')}.json")
        write_report(after[-1], msgspec.structs.replace(found, rows=tuple(rows), runs=[]))
    for path in set(before) - set(after):
        try:
            path.unlink()
        except OSError as error:
            raise UserError(f"{path}: {error.strerror}: expected a file to replace") from None
    return sorted(after)
