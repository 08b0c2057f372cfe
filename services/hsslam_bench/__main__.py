"""`hsslam-bench`: runs the service, measures the table, prints and stores it.

Subcommands: `ablation|replica|tum|scannet` measure a table of the paper (see `tables`), `peers` runs other
systems on the same sequences (see `peers`), `compare`, `plots` and `keep` read result files (see
`result_commands`).
"""

import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from hsslam_bench.batch.lockstep_tasks import measure_as_tasks
from hsslam_bench.checks.catalogue import catalogue
from hsslam_bench.checks.check import NO_FIGURE, Check, Row, perform, select
from hsslam_bench.options import BenchOptions
from hsslam_bench.peers.command import peers_command
from hsslam_bench.result_commands import RESULT_COMMANDS
from hsslam_bench.results.document import fill_document
from hsslam_bench.results.report import report, with_rows, write_report
from hsslam_bench.runs.session import Session
from hsslam_bench.tables.command import table_command
from hsslam_bench.tables.paper_tables import TABLES
from hsslam_node.environment import BENCH_DATA
from hsslam_node.errors import UserError, did_you_mean
from hsslam_services.commands.cli import exit_code, parse_options
from hsslam_services.commands.serve_command_line import parse_command_line

_STYLES = {"ok": "green", "NOT MET": "bold red", "skipped": "yellow"}


def main() -> int:
    """Run the command; exit code 0, 1 or 2, see `BenchOptions`."""
    return exit_code(lambda: _command(sys.argv[1:]))


def _command(args: Sequence[str]) -> int | None:
    if args and args[0] in TABLES:
        return table_command(args[0], args[1:])
    if args and args[0] == "peers":
        return peers_command(args[1:])
    if args and args[0] in RESULT_COMMANDS:
        return RESULT_COMMANDS[args[0]](args[1:])
    if args and not args[0].startswith("-"):
        raise _unknown(args[0])
    options, extra = _parsed(args)
    if not options.docs:
        return _bench(options, extra)
    for document in options.docs:
        fill_document(document, list(options.results))
    return None


def _unknown(word: str) -> UserError:
    known = [*TABLES, "peers", *RESULT_COMMANDS]
    return UserError(f"{word}: expected {', '.join(known)} or options{did_you_mean(word, known)}")


def _parsed(args: Sequence[str]) -> tuple[BenchOptions, list[str]]:
    """The options, and the arguments of hsslam-serve after `--`."""
    own, extra = list(args), []
    if "--" in own:
        at = own.index("--")
        own, extra = own[:at], own[at + 1 :]
        parse_command_line(extra)  # an option that is wrong would cost each row
    return parse_options(BenchOptions, "hsslam-bench", own), extra


def _bench(options: BenchOptions, extra: list[str]) -> int:
    checks = select(catalogue(), list(options.only))
    if options.list:
        print("\n".join(check.name for check in (checks if options.only else catalogue())))
        return 0
    data = options.data or Path(BENCH_DATA.value() or "../shared/data")
    out = options.out or Path("runs/bench") / f"{time.strftime('%Y%m%d-%H%M%S')}.json"
    session = Session(data, out.with_suffix("").absolute(), options.quick, extra)
    result = report(session)
    commit = result.commit
    rows: list[Row] = []
    console = Console(emoji=False, highlight=False, markup=False)
    interrupted = False

    order = [check.name for check in checks]

    def keep(row: Row) -> None:
        nonlocal result
        rows.append(row)
        rows.sort(key=lambda kept: order.index(kept.name))
        result = with_rows(result, session, rows)
        write_report(out, result)

    try:
        _measure(checks, session, options.address, keep, console)
    except KeyboardInterrupt:
        interrupted = True
    console.print(_table(rows))
    for row in rows:
        if row.verdict == "skipped":
            console.print(f"skipped {row.name}: {row.measured}", soft_wrap=True)
    if result.commit != commit:
        text = f"warning: the code has changed meanwhile: commits {result.commit}: measure again"
        console.print(text, soft_wrap=True)
    console.print(f"results: {out}", soft_wrap=True)
    is_empty = all(row.verdict in NO_FIGURE for row in rows)
    if is_empty and not interrupted:
        print("error: no row could be measured", file=sys.stderr)
    return int(interrupted or is_empty or any(row.verdict == "NOT MET" for row in rows))


def _measure(
    checks: Sequence[Check],
    session: Session,
    address: str,
    keep: Callable[[Row], None],
    console: Console,
) -> None:
    """Measure and keep all rows, and show the progress; without a terminal print one line a row.

    With an address of Ray measure rows of lockstep runs first, several at once; then the others in turn.
    """
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeElapsedColumn(), console=console, transient=True) as progress:
        task = progress.add_task("", total=len(checks))

        def take(row: Row) -> None:
            keep(row)
            progress.advance(task)
            if not console.is_terminal:
                console.print(f"{row.name}: {row.verdict}: {row.measured}", soft_wrap=True)

        if address:
            session.say = lambda text: progress.update(task, description=text)
            _measure_as_tasks(
                [check for check in checks if check.is_lockstep], session, address, take
            )
        for check in checks:
            if address and check.is_lockstep:
                continue
            session.say = lambda text, name=check.name: progress.update(
                task, description=f"{name} {text}"
            )
            session.say("")
            take(perform(check, session))


def _measure_as_tasks(
    checks: Sequence[Check], session: Session, address: str, take: Callable[[Row], None]
) -> None:
    try:
        measure_as_tasks(checks, session, address, take)
    except ModuleNotFoundError as error:
        wanted = "pip install 'hsslam-node[batch]'"
        raise UserError(
            f"--address {address}: package {error.name} is missing: expected {wanted}"
        ) from None


def _table(rows: list[Row]) -> Table:
    table = Table("what", "bound", "measured", "ok")
    for row in rows:
        what = Text.assemble(row.what, (f" ({row.name})", "dim"))
        verdict = Text(row.verdict, _STYLES.get(row.verdict, ""))
        table.add_row(what, row.bound, row.measured, verdict)
    return table


if __name__ == "__main__":
    sys.exit(main())
