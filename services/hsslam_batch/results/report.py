"""`hsslam-batch report`: table, sums and worst logs of a batch, and its changes against another batch."""

from collections import Counter
from collections.abc import Mapping, Sequence

from rich.console import Console
from rich.table import Column, Table

from hsslam_batch.attempt.outcome import NOT_EVALUATED
from hsslam_batch.options import ReportOptions
from hsslam_batch.plan.log import read_manifest
from hsslam_batch.plan.read_batch import read_batch
from hsslam_batch.results.comparison import FIGURES, Change, Row, compare, newly_failed, worst
from hsslam_batch.results.costs import cost_table, costs
from hsslam_batch.results.runs_table import known_rows, renew_runs
from hsslam_batch.results.tally import duration
from hsslam_node.errors import UserError
from hsslam_services.commands.cli import parse_options, table_console

_WORSE = 1


def report_command(args: Sequence[str]) -> int:
    """Write the table and print the report; returns the exit code.

    Raises:
        UserError: the folder has no batch, or is not writable.
    """
    options = parse_options(ReportOptions, "hsslam-batch report", args)
    rows = _rows(options.out)
    before = [] if options.against is None else _rows_before(options.against, rows)
    console = table_console()
    for line in _sums(rows):
        console.print(line, soft_wrap=True)
    if found := costs(rows):
        console.print(cost_table(found))
    if options.against is None:
        _print(_worst_logs(rows, options.worst), console)
        _plot({options.out: rows}, [], options, console)
        return 0
    changes = compare(before, rows, options.noise)
    _plot({options.against: before, options.out: rows}, changes, options, console)
    return _show_changes(before, rows, changes, options, console)


def _rows(out: str) -> list[Row]:
    """The rows of all logs that are or were done or failed; the table has them from now on."""
    batch = read_batch(out)
    with batch.expect_writable():
        return list(renew_runs(batch, read_manifest(batch.out)))


def _rows_before(against: str, rows: Sequence[Row]) -> list[Row]:
    """The rows of the earlier batch, which is not changed.

    Raises:
        UserError: it has none of the logs, so that nothing can be compared.
    """
    batch = read_batch(against)
    before: list[Row] = list(known_rows(batch, read_manifest(batch.out)))
    if {row["name"] for row in before}.isdisjoint(row["name"] for row in rows):
        raise UserError(
            f"--against {against}: has results of none of these logs ({len(before)} against {len(rows)} "
            "rows): expected a batch with logs of the same names"
        )
    return before


def _sums(rows: Sequence[Row]) -> list[str]:
    kinds = Counter(row["kind"] for row in rows)
    done = [row for row in rows if row["kind"] == "done"]
    frames, lost, core_s = (sum(row[name] for row in done) for name in ("frames", "lost", "core_s"))
    failed_s = sum(row["core_s"] for row in rows if row["kind"] != "done")
    counts = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
    lines = [f"{len(rows)} logs: {counts or 'none has run'}"]
    if frames:
        share = f"{1e2 * lost / frames:.2f} %"
        each = f"{1e3 * core_s / frames:.0f} ms a frame"
        lines.append(
            f"{frames} frames, {lost} lost ({share}); core time {duration(core_s)}, {each}"
        )
    if count := sum(row["reason"].startswith(NOT_EVALUATED) for row in done):
        lines.append(
            f"{count} logs that are done could not be evaluated: see reason in runs.parquet"
        )
    if failed_s:
        lines.append(
            f"core time of failed logs: {duration(failed_s)} (only the last attempt of each)"
        )
    return lines


def _print(table: Table, console: Console) -> None:
    if table.row_count:
        console.print(table)


def _worst_logs(rows: Sequence[Row], count: int) -> Table:
    table = Table("figure", Column("worst logs", overflow="fold"))
    done = [row for row in rows if row["kind"] == "done"]
    for figure in FIGURES:
        shown = [f"{name} {figure.scale * value:.4g}" for name, value in worst(done, figure, count)]
        if shown:
            table.add_row(figure.title, "\n".join(shown))
    return table


def _plot(
    batches: Mapping[str, Sequence[Row]],
    changes: Sequence[Change],
    options: ReportOptions,
    console: Console,
) -> None:
    if options.plots is None:
        return
    from hsslam_batch.results.plots import draw, draw_changes  # Matplotlib takes a second

    written = [*draw(batches, options.plots), *draw_changes(changes, options.noise, options.plots)]
    for path in written:
        console.print(f"plot: {path}", soft_wrap=True)


def _show_changes(
    before: Sequence[Row],
    after: Sequence[Row],
    changes: Sequence[Change],
    options: ReportOptions,
    console: Console,
) -> int:
    failed = newly_failed(before, after)
    columns = ("figure", "logs", "median of after / before", "better", "worse")
    table = Table(*columns, Column("worst of these", overflow="fold"))
    for change in changes:
        if change.median_ratio is None:
            continue
        scale = change.figure.scale
        shown = [
            f"{pair.name} {scale * pair.before:.4g} -> {scale * pair.after:.4g}"
            for pair in change.worse[: options.worst]
        ]
        table.add_row(
            change.figure.title,
            str(len(change.pairs)),
            f"{change.median_ratio:.3f}",
            str(change.better),
            str(len(change.worse)),
            "\n".join(shown),
        )
    _print(table, console)
    for change in changes:
        if change.gone:
            console.print(_gone_line(change, options.worst), soft_wrap=True)
    for row in failed[: options.worst]:
        console.print(
            f"{row['name']}: was done, now {row['kind']}: {row['reason']}", soft_wrap=True
        )
    only = {row["name"] for row in before} ^ {row["name"] for row in after}
    if only:
        console.print(f"{len(only)} logs are done or failed in only one of the two batches")
    is_worse = failed or any(change.worse or change.gone for change in changes)
    return _WORSE if is_worse else 0


def _gone_line(change: Change, most: int) -> str:
    have = "1 log has" if len(change.gone) == 1 else f"{len(change.gone)} logs have"
    names = ", ".join(change.gone[:most]) + (", ..." if len(change.gone) > most else "")
    return f"{have} no {change.figure.title.partition(',')[0]} any more: {names}"
