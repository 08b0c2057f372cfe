"""`hsslam-bench`: run the service, measure the table, print and store it.

`... ablation|replica|tum|scannet` measures a table of the paper; see `tables`. `... compare A.json B.json`,
`... plots FILE.json` and `... keep FILE.json` take results; see `result_commands`.
"""

import argparse
import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from hsslam_bench.checks.catalogue import catalogue
from hsslam_bench.checks.check import Check, Row, perform, select
from hsslam_bench.result_commands import RESULT_COMMANDS
from hsslam_bench.results.document import fill_document
from hsslam_bench.results.report import machine, report, write_report
from hsslam_bench.runs.session import Session
from hsslam_bench.tables.command import table_command
from hsslam_bench.tables.paper_tables import TABLES
from hsslam_node import __version__
from hsslam_node.errors import UserError

_STYLES = {"ok": "green", "NOT MET": "bold red", "skipped": "yellow"}


def main() -> int:
    """Exit code 0: all bounds met; 1: one is not met, or interrupted; 2: bad input."""
    try:
        if sys.argv[1:2] and sys.argv[1] in TABLES:
            return table_command(sys.argv[1], sys.argv[2:])
        if sys.argv[1:2] and sys.argv[1] in RESULT_COMMANDS:
            RESULT_COMMANDS[sys.argv[1]](sys.argv[2:])
            return 0
        arguments, extra = _arguments(sys.argv[1:])
        if arguments.docs:
            for document in arguments.docs:
                fill_document(document, arguments.results)
            return 0
        return _bench(arguments, extra)
    except UserError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


def _arguments(args: Sequence[str]) -> tuple[argparse.Namespace, list[str]]:
    """The options, and what follows `--`."""
    own, extra = list(args), []
    if "--" in own:
        at = own.index("--")
        own, extra = own[:at], own[at + 1 :]
    parser = argparse.ArgumentParser(
        prog="hsslam-bench",
        description="Measure what the README claims. A bound that is not met gives exit code 1.",
        epilog="Options after -- are added to every hsslam-serve; the figures are then not those "
        "of the protocol. With --docs nothing is measured. Three commands take results: compare A.json "
        "B.json, plots FILE.json --to FOLDER, and keep FILE.json --to FOLDER. Four measure the paper's "
        f"tables: {', '.join(TABLES)}; each has its own --help.",
    )
    data = os.environ.get("HSSLAM_TEST_DATA", "../shared/data")
    out = Path("runs/bench") / f"{time.strftime('%Y%m%d-%H%M%S')}.json"
    version = f"%(prog)s {__version__}"
    parser.add_argument("--version", action="version", version=version)
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="rows or groups")
    parser.add_argument("--quick", action="store_true", help="one seed, few frames: a try-out")
    parser.add_argument("--list", action="store_true", help="print the names of the rows and end")
    parser.add_argument("--data", type=Path, default=Path(data), help="sequences (%(default)s)")
    parser.add_argument("--out", type=Path, default=out, help="result file (%(default)s)")
    parser.add_argument(
        "--docs", type=Path, nargs="+", help="documents whose tables are written from --from"
    )
    parser.add_argument(
        "--from", dest="results", type=Path, nargs="+", metavar="JSON", help="result files"
    )
    arguments = parser.parse_args(own)
    if bool(arguments.docs) != bool(arguments.results):
        parser.error("--docs and --from belong together")
    return arguments, extra


def _bench(arguments: argparse.Namespace, extra: list[str]) -> int:
    checks = select(catalogue(), arguments.only)
    if arguments.list:
        print("\n".join(check.name for check in checks))
        return 0
    session = Session(arguments.data, arguments.out.with_suffix(""), arguments.quick, extra)
    on = machine()
    rows: list[Row] = []
    console = Console(emoji=False, highlight=False, markup=False)
    interrupted = False

    def keep(row: Row) -> None:
        rows.append(row)
        write_report(arguments.out, report(session, on, rows))

    try:
        _measure(checks, session, keep, console)
    except KeyboardInterrupt:
        interrupted = True
    console.print(_table(rows))
    for row in rows:
        if row.verdict == "skipped":
            console.print(f"skipped {row.name}: {row.measured}", soft_wrap=True)
    console.print(f"results: {arguments.out}", soft_wrap=True)
    return int(interrupted or any(row.verdict == "NOT MET" for row in rows))


def _measure(
    checks: list[Check], session: Session, keep: Callable[[Row], None], console: Console
) -> None:
    """Measure and keep one row after the other, showing how far it is; off a terminal one line a row."""
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeElapsedColumn(), console=console, transient=True) as progress:
        task = progress.add_task("", total=len(checks))
        for check in checks:
            session.say = lambda text, name=check.name: progress.update(
                task, description=f"{name} {text}"
            )
            session.say("")
            row = perform(check, session)
            keep(row)
            progress.advance(task)
            if not console.is_terminal:
                console.print(f"{row.name}: {row.verdict}: {row.measured}", soft_wrap=True)


def _table(rows: list[Row]) -> Table:
    table = Table("what", "bound", "measured", "ok")
    for row in rows:
        what = Text.assemble(row.what, (f" ({row.name})", "dim"))
        verdict = Text(row.verdict, _STYLES.get(row.verdict, ""))
        table.add_row(what, row.bound, row.measured, verdict)
    return table


if __name__ == "__main__":
    sys.exit(main())
