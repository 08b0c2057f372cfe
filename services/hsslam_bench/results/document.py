"""Writes the tables of the documents from result files.

A table lies between `<!-- bench:end -->` and a marker before it that names its content:

    <!-- bench:begin -->              all rows
    <!-- bench:rows NAME ... -->      the rows of these names or groups
    <!-- bench:columns NAME ... -->   their values, a column for each run
    <!-- bench:summary -->            how many bounds are met, and which are not
"""

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from hsslam_bench.checks.check import Check, Row, select
from hsslam_bench.results.newest_rows import NewestRows, read_for_documents
from hsslam_bench.results.report import Report
from hsslam_node.durable_file import write_durably
from hsslam_node.errors import UserError

BEGIN, END = "<!-- bench:begin -->", "<!-- bench:end -->"
_BLOCK = re.compile(
    r"<!-- bench:(?P<kind>begin|rows|columns|summary)(?P<names>[^\n]*?) -->\n(?P<old>.*?)<!-- bench:end -->",
    re.DOTALL,
)
_MARKER = "<!-- bench:"
_HEAD = ("name", "what", "bound", "measured", "")
_MARKS = {"ok": "ok", "NOT MET": "**NOT MET**", "measured": "", "skipped": "", "not measured": ""}
_SHOWN = 0.05  # lines whose values all round to 0.0 are left out
_END = "<!-- table:end -->"


def fill_document(document: Path, results: Sequence[Path]) -> None:
    """Renew the tables between the markers; a row comes from the last file that measured it.

    Raises:
        UserError: the document has no markers, a file is no result file or did not follow the protocol.
    """
    reports = [read_for_documents(path) for path in results]
    _edit(document, lambda text: with_tables(text, str(document), reports))


def with_tables(text: str, name: str, reports: Sequence[Report]) -> str:
    """The text with its tables renewed.

    Raises:
        UserError: the text has no markers, or a marker names an unknown row.
    """
    newest = NewestRows.of(reports)

    def renewed(block: re.Match) -> str:
        marker = block.group(0).partition("\n")[0]
        if _MARKER in block["old"]:
            raise UserError(f"--docs {name}: {marker}: expected {END} before the next marker")
        if block["kind"] == "summary":
            return "\n".join((marker, *_summary(newest), END))
        try:
            checks = select(newest.checks, block["names"].split())
        except UserError as error:
            raise UserError(f"--docs {name}: {marker}: {error}") from None
        table = _columns if block["kind"] == "columns" else _table
        lines = [*table([newest.rows[c.name] for c in checks]), *_origins(newest, checks)]
        return "\n".join((marker, *lines, END))

    filled, count = _BLOCK.subn(renewed, text)
    if count == 0:
        raise UserError(f"--docs {name}: expected the lines {BEGIN} and {END}")
    return filled


def _summary(newest: NewestRows) -> list[str]:
    """Counts of the rows with a bound, and the names of those that do not meet it."""
    bounded = [newest.rows[check.name] for check in newest.checks if newest.rows[check.name].bound]
    met = [row.name for row in bounded if row.verdict == "ok"]
    missed = [row.name for row in bounded if row.verdict == "NOT MET"]
    unmeasured = [row.name for row in bounded if row.verdict not in ("ok", "NOT MET")]
    lines = [f"{len(met)} of {len(bounded)} bounds are met."]
    if missed:
        lines += ["", f"Not met, {len(missed)}: {_names(missed)}."]
    if unmeasured:
        lines += ["", f"Not measured, {len(unmeasured)}: {_names(unmeasured)}."]
    return lines


def _names(names: Sequence[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _origins(newest: NewestRows, checks: Sequence[Check]) -> list[str]:
    """Lines with time and machine of the measurements of these rows."""
    rows = [newest.rows[check.name] for check in checks]
    groups = newest.by_report(row for row in rows if row.verdict != "not measured")
    lines = []
    for found, its in groups:
        which = "All" if len(groups) == 1 else ", ".join(f"`{row.name}`" for row in its)
        lines += ["", f"{which}: {_circumstances(found)}"]
    return lines


def _table(rows: Sequence[Row]) -> list[str]:
    cells = [
        (f"`{r.name}`", r.what, r.bound or "-", _measured_text(r), _MARKS[r.verdict]) for r in rows
    ]
    return _lines([_HEAD, *cells])


def _columns(rows: Sequence[Row]) -> list[str]:
    """Rows whose values are a mapping for each run: what each measures, a line a value, a column a run."""
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
        cells.append((f"`{row.name}`", row.what, *[""] * len(columns)))
        cells += [("", *line) for line in lines]
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


def fill_table(document: Path, name: str, text: str) -> None:
    """Put the text between the lines `<!-- table:NAME -->` and `<!-- table:end -->`.

    Raises:
        UserError: the document or its marker lines are missing.
    """
    begin = f"<!-- table:{name} -->"
    pattern = re.compile(f"{re.escape(begin)}\n.*?{re.escape(_END)}", re.DOTALL)

    def filled(old: str) -> str:
        new, count = pattern.subn(lambda _: f"{begin}\n{text.strip()}\n{_END}", old)
        if count == 0:
            raise UserError(f"--docs {document}: expected the lines {begin} and {_END}")
        return new

    _edit(document, filled)


def _edit(document: Path, change: Callable[[str], str]) -> None:
    """Replace the text of a document in one step; line ends stay as they are.

    Raises:
        UserError: the document cannot be read or written, or is not UTF-8.
    """
    try:
        old = document.read_bytes().decode()
        end = "\r\n" if "\r\n" in old else "\n"
        new = change(old.replace("\r\n", "\n"))
        write_durably(document, new.replace("\n", end).encode())
    except OSError as error:
        raise UserError(f"--docs {document}: {error.strerror}: expected a document") from None
    except UnicodeDecodeError:
        raise UserError(f"--docs {document}: is not UTF-8: expected a document") from None
