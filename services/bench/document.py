"""The table of docs/results.md, written from result files and from nothing else."""

from collections.abc import Sequence
from pathlib import Path

from hsslam_node.errors import UserError
from hsslam_node.services.bench.catalogue import catalogue
from hsslam_node.services.bench.check import Row, unmeasured
from hsslam_node.services.bench.report import Report, read_report

BEGIN, END = "<!-- bench:begin -->", "<!-- bench:end -->"
_HEAD = ("name", "what", "bound", "measured", "")
_MARKS = {"ok": "ok", "NOT MET": "**NOT MET**", "measured": "", "skipped": "", "not measured": ""}


def fill_document(document: Path, results: Sequence[Path]) -> None:
    """Renew the table between the markers; a row comes from the last file that measured it.

    Raises:
        UserError: no markers, not a result file, or one that did not follow the protocol.
    """
    reports = [_full(path) for path in results]
    try:
        old = document.read_text()
        document.write_text(with_table(old, str(document), reports))
    except OSError as error:
        raise UserError(f"--docs {document}: {error.strerror}: expected a document") from None


def with_table(text: str, name: str, reports: Sequence[Report]) -> str:
    """The text with its table renewed.

    Raises:
        UserError: the markers are not there.
    """
    head, begin, rest = text.partition(BEGIN)
    _, end, tail = rest.partition(END)
    if not (begin and end):
        raise UserError(f"--docs {name}: expected the lines {BEGIN} and {END}")
    return f"{head}{begin}\n{_table(reports)}\n{end}{tail}"


def _full(path: Path) -> Report:
    found = read_report(path)
    if found.protocol.get("quick") or found.protocol.get("extra_options"):
        raise UserError(f"--from {path}: measured with --quick or extra options: expected neither")
    return found


def _table(reports: Sequence[Report]) -> str:
    origin: dict[str, int] = {}
    rows: dict[str, Row] = {check.name: unmeasured(check) for check in catalogue()}
    for number, found in enumerate(reports):
        for row in found.rows:
            if row.name in rows and row.verdict not in ("skipped", "not measured"):
                rows[row.name], origin[row.name] = row, number
    cells = [_HEAD, ("---",) * len(_HEAD)]
    cells += [
        (f"`{r.name}`", r.what, r.bound or "-", r.measured or "not measured", _MARKS[r.verdict])
        for r in rows.values()
    ]
    lines = [f"| {' | '.join(_escaped(cell) for cell in row)} |" for row in cells]
    for number in sorted(set(origin.values())):
        names = [f"`{name}`" for name, its in origin.items() if its == number]
        which = "All" if len(set(origin.values())) == 1 else ", ".join(names)
        lines += ["", f"{which}: {_circumstances(reports[number])}"]
    return "\n".join(lines)


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
