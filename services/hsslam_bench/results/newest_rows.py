"""Finds the newest figure of each row in many result files, and keeps it in docs/figures."""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from hsslam_bench.checks.catalogue import catalogue
from hsslam_bench.checks.check import NO_FIGURE, Check, Row, unmeasured
from hsslam_bench.results.report import Report, read_report, write_report
from hsslam_node.errors import UserError


@dataclass(frozen=True)
class NewestRows:
    """A row for every check of the catalogue, and the report it is from, if any."""

    checks: Sequence[Check]
    rows: Mapping[str, Row]
    origin: Mapping[str, Report]

    @staticmethod
    def of(reports: Sequence[Report]) -> "NewestRows":
        """Take each row from the last report that measured it, else from the last one with a reason why not.

        A row whose `what`, `bound` or `version` differs from the check does not count.
        """
        checks = {check.name: check for check in catalogue()}
        wanted = {name: unmeasured(check) for name, check in checks.items()}
        rows = dict(wanted)
        origin: dict[str, Report] = {}
        for found in reports:
            for row in found.rows:
                if row.name not in rows or row.definition != wanted[row.name].definition:
                    continue
                is_measured = row.verdict not in NO_FIGURE
                if is_measured or row.verdict == rows[row.name].verdict == "not measured":
                    rows[row.name], origin[row.name] = row, found
        return NewestRows(list(checks.values()), rows, origin)

    def by_report(self, rows: Iterable[Row]) -> list[tuple[Report, list[Row]]]:
        """The rows grouped by their report; rows without a report are left out."""
        groups: dict[int, tuple[Report, list[Row]]] = {}
        for row in rows:
            if (found := self.origin.get(row.name)) is not None:
                groups.setdefault(id(found), (found, []))[1].append(row)
        return list(groups.values())


def read_for_documents(path: Path) -> Report:
    """Read a result file that followed the protocol.

    Raises:
        UserError: the file is no result file, or was measured with --quick or extra options.
    """
    found = read_report(path)
    if found.protocol.get("quick") or found.protocol.get("extra_options"):
        raise UserError(f"{path}: measured with --quick or extra options: expected neither")
    return found


def keep(folder: Path, results: Sequence[Path]) -> list[Path]:
    """Add the rows of `results` to `folder`; remove rows that they replace or the catalogue no longer has.

    Returns the files of `folder`, oldest first: one for each benchmark, named by its time.

    Raises:
        UserError: a file is no result file or did not follow the protocol, or `folder` is not writable.
    """
    before = sorted(folder.glob("*.json"))
    reports = [read_for_documents(path) for path in (*before, *results)]
    newest = NewestRows.of(sorted(reports, key=lambda found: found.time))
    after: list[Path] = []
    for found, rows in newest.by_report(newest.rows.values()):
        after.append(_free_name(folder / f"{found.time.replace(':', '')}.json", after))
        write_report(after[-1], msgspec.structs.replace(found, rows=tuple(rows), runs=[]))
    for path in set(before) - set(after):
        try:
            path.unlink()
        except OSError as error:
            raise UserError(f"{path}: {error.strerror}: expected a file to replace") from None
    return sorted(after)


def _free_name(path: Path, taken: Sequence[Path]) -> Path:
    """The path, or with a number if it is taken: two benchmarks may begin in the same second."""
    names = (path.with_stem(f"{path.stem}-{number}") for number in itertools.count(2))
    return next(each for each in itertools.chain([path], names) if each not in taken)
