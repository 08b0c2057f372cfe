"""The tables of the documents, written from result files and from nothing else.

A table stands between a marker that says what it holds and `<!-- bench:end -->`:

    <!-- bench:begin -->              all rows
    <!-- bench:rows NAME ... -->      the rows of these names or groups
    <!-- bench:columns NAME ... -->   their values, a column for each run they are of
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hsslam_node.errors import UserError
from hsslam_node.services.bench.catalogue import catalogue
from hsslam_node.services.bench.check import Check, Row, select, unmeasured
from hsslam_node.services.bench.report import Report, read_report

BEGIN, END = "<!-- bench:begin -->", "<!-- bench:end -->"
_BLOCK = re.compile(
    r"<!-- bench:(?P<kind>begin|rows|columns)(?P<names>[^\n]*?) -->\n(?P<old>.*?)<!-- bench:end -->",
    re.DOTALL,
)
_HEAD = ("name", "what", "bound", "measured", "")
_MARKS = {"ok": "ok", "NOT MET": "**NOT MET**", "measured": "", "skipped": "", "not measured": ""}
_SHOWN = 0.05  # values that would be shown as 0.0 in every column are left out


def fill_document(document: Path, results: Sequence[Path]) -> None:
    """Renew the tables between the markers; a row comes from the last file that measured it.

    Raises:
        UserError: no markers, not a result file, or one that did not follow the protocol.
    """
    reports = [_full(path) for path in results]
    try:
        old = document.read_text()
        document.write_text(with_tables(old, str(document), reports))
    except OSError as error:
        raise UserError(f"--docs {document}: {error.strerror}: expected a document") from None


def with_tables(text: str, name: str, reports: Sequence[Report]) -> str:
    """The text with its tables renewed.

    Raises:
        UserError: the markers are not there, or name rows that are not.
    """
    measured = _Measured.of(reports)

    def renewed(block: re.Match) -> str:
        marker = block.group(0).partition("\n")[0]
        checks = select(measured.checks, block["names"].split())
        table = _columns if block["kind"] == "columns" else _table
        lines = [*table([measured.rows[c.name] for c in checks]), *measured.origins(checks)]
        return "\n".join((marker, *lines, END))

    filled, count = _BLOCK.subn(renewed, text)
    if count == 0:
        raise UserError(f"--docs {name}: expected the lines {BEGIN} and {END}")
    return filled


@dataclass(frozen=True)
class _Measured:
    """The newest of every row, and which report it is from."""

    checks: Sequence[Check]
    rows: Mapping[str, Row]
    origin: Mapping[str, Report] = field(default_factory=dict)

    @staticmethod
    def of(reports: Sequence[Report]) -> "_Measured":
        """A row that was measured as something else, or against another bound, does not count."""
        checks = {check.name: check for check in catalogue()}
        rows = {name: unmeasured(check) for name, check in checks.items()}
        origin: dict[str, Report] = {}
        for found in reports:
            for row in found.rows:
                check = checks.get(row.name)
                if check is None or (row.what, row.bound) != (check.what, check.bound):
                    continue
                if row.verdict == "not measured" and row.name not in origin:
                    rows[row.name] = row
                elif row.verdict not in ("skipped", "not measured"):
                    rows[row.name], origin[row.name] = row, found
        return _Measured(list(checks.values()), rows, origin)

    def origins(self, checks: Sequence[Check]) -> list[str]:
        """Lines that say when and where these rows were measured."""
        names: dict[int, list[str]] = {}
        reports = {id(found): found for found in self.origin.values()}
        for check in checks:
            if check.name in self.origin:
                names.setdefault(id(self.origin[check.name]), []).append(f"`{check.name}`")
        lines = []
        for key, its in names.items():
            which = "All" if len(names) == 1 else ", ".join(its)
            lines += ["", f"{which}: {_circumstances(reports[key])}"]
        return lines


def _full(path: Path) -> Report:
    found = read_report(path)
    if found.protocol.get("quick") or found.protocol.get("extra_options"):
        raise UserError(f"--from {path}: measured with --quick or extra options: expected neither")
    return found


def _table(rows: Sequence[Row]) -> list[str]:
    cells = [
        (f"`{r.name}`", r.what, r.bound or "-", _measured_text(r), _MARKS[r.verdict]) for r in rows
    ]
    return _lines([_HEAD, *cells])


def _columns(rows: Sequence[Row]) -> list[str]:
    """Values of rows that hold a mapping for every run: a line for each value, its row before it."""
    columns = list({run: None for row in rows for run in row.values})
    cells: list[tuple[str, ...]] = []
    for row in rows:
        if not row.values:
            cells.append((f"`{row.name}`", _measured_text(row), *[""] * len(columns)))
            continue
        names = {name: None for values in row.values.values() for name in values}
        shown = [[row.values.get(run, {}).get(name) for run in columns] for name in names]
        lines = [
            (name, *map(_number, values))
            for name, values in zip(names, shown, strict=True)
            if any(value is not None and value >= _SHOWN for value in values)
        ]
        cells += [(f"`{row.name}`" if k == 0 else "", *line) for k, line in enumerate(lines)]
    return _lines([("row", "", *columns), *cells])


def _measured_text(row: Row) -> str:
    if row.verdict != "not measured":
        return row.measured
    return f"not measured: {row.measured}" if row.measured else "not measured"


def _number(value: Any) -> str:
    return "-" if value is None else f"{value:.1f}"


def _lines(cells: Sequence[Sequence[str]]) -> list[str]:
    ruled = [cells[0], ["---"] * len(cells[0]), *cells[1:]]
    return [f"| {' | '.join(_escaped(cell) for cell in row)} |" for row in ruled]


def _circumstances(found: Report) -> str:
    machine, versions = found.machine, found.versions
    names = ("python", "torch", "numpy", "numba", "opencv-python-headless", "eclipse-zenoh")
    return (
        f"{found.time}, commit {found.commit or 'unknown'}, {machine.cpu}, {machine.cores} cores, "
        f"{machine.memory_bytes / 2**30:.0f} GiB, {machine.system}, "
        f"load before {machine.load_before:.1f}; "
        + ", ".join(f"{name} {versions[name]}" for name in names if name in versions)
        + "."
    )


def _escaped(cell: str) -> str:
    return cell.replace("|", "\\|").replace("\n", " ")
