"""A measured table with mean and standard deviation over the seeds, for the terminal and as markdown."""

import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from rich.table import Table
from rich.text import Text

from hsslam_bench.tables.paper_tables import PaperRow, PaperTable
from hsslam_bench.tables.plan import RunResult

HIGHER_IS_BETTER = ("completion_pct", "completion_lit_pct", "psnr_db", "ssim", "fps")
_UNORDERED = ("model_mib", "fps", "lost")  # not in the paper's ablation
_HEADS: Mapping[str, tuple[str, int]] = MappingProxyType(  # title, digits
    {
        "accuracy_cm": ("acc. cm", 2),
        "completion_cm": ("comp. cm", 2),
        "completion_pct": ("comp. %", 2),
        "accuracy_lit_cm": ("acc. lit. cm", 2),
        "completion_lit_cm": ("comp. lit. cm", 2),
        "completion_lit_pct": ("comp. lit. %", 2),
        "depth_l1_cm": ("depth L1 cm", 2),
        "psnr_db": ("PSNR dB", 2),
        "ssim": ("SSIM", 3),
        "ate_cm": ("ATE cm", 3),
        "ate_mean_cm": ("ATE mean cm", 3),
        "ate_online_cm": ("ATE online cm", 3),
        "lost": ("lost", 1),
        "model_mib": ("model MiB", 1),
        "fps": ("frames/s", 2),
    }
)


@dataclass(frozen=True)
class Figure:
    """Mean and sample standard deviation over the seeds; deviation None with one seed."""

    mean: float
    deviation: float | None
    seeds: int
    sequences: frozenset[str]  # over which it is the mean


@dataclass(frozen=True)
class MeasuredRow:
    """A row with our figures and the paper's, by metric."""

    row: PaperRow
    figures: Mapping[str, Figure]
    paper: Mapping[str, float]
    note: str  # what is missing
    sequences: int  # that were measured; a figure may lack some of them


def measured_rows(
    table: PaperTable, rows: Sequence[PaperRow], results: Iterable[RunResult], method: str
) -> list[MeasuredRow]:
    """The rows, and their mean if the table has one (over sequences first, then over seeds)."""
    good = [result for result in results if not result.error]
    seeds = {result.seed for result in good}
    found = []
    for row in rows:
        mine = [result for result in good if result.row == row.name]
        figures = {metric: _figure(mine, metric) for metric in table.metrics}
        of = good if table.mean is None else mine  # rows of the ablation share their sequences
        sequences = len({result.sequence for result in of})
        found.append(_measured(row, figures, method, _note(mine, seeds), sequences))
    if table.mean is not None:
        measured = {row.row.name for row in found if row.figures}
        of_rows = [result for result in good if result.row in measured]
        figures = {metric: _figure(of_rows, metric) for metric in table.metrics}
        note = "" if len(measured) == len(table.rows) else f"of {len(measured)}/{len(table.rows)}"
        found.append(_measured(table.mean, figures, method, note, len(measured)))
    return found


def disagreements(rows: Sequence[MeasuredRow], metrics: Sequence[str]) -> list[str]:
    """A line for each row that is better than the full model but worse in the paper, or the reverse.

    No lines if the full model was not measured. Differences below one standard deviation (root of the sum of
    both variances), single seeds, and means over other seeds or sequences are ignored.
    """
    full = next((row for row in rows if row.row.name == "full"), None)
    if full is None or not full.figures:
        return []
    lines = []
    for other in rows:
        found = []
        for metric in (m for m in metrics if m not in _UNORDERED):
            ours = _difference(full, other, metric)
            if ours * _paper_difference(full, other, metric) < 0:
                word = "better" if ours > 0 else "worse"
                here = f"{_text(other.figures[metric])} against {_text(full.figures[metric])}"
                paper = f"{other.paper[metric]:g} against {full.paper[metric]:g}"
                found.append(f"{metric} {word} ({here}; paper {paper})")
        if found:
            title = f"({other.row.name}) {other.row.title}"
            lines.append(
                f"Not as in the paper, against the full model: {title}: {', '.join(found)}."
            )
    return lines


def _note(results: Sequence[RunResult], seeds: set[int]) -> str:
    """The note of a row: "no result", or how many of the other rows' seeds it has."""
    mine = {result.seed for result in results}
    if not mine:
        return "no result"
    return "" if mine == seeds else f"{len(mine)} of {len(seeds)} seeds"


def _measured(
    row: PaperRow, figures: Mapping[str, Figure | None], method: str, note: str, sequences: int
) -> MeasuredRow:
    present = {metric: figure for metric, figure in figures.items() if figure is not None}
    return MeasuredRow(row, present, row.paper.get(method, {}), note, sequences)


def _figure(results: Sequence[RunResult], metric: str) -> Figure | None:
    """The figure over the seeds that have a value on every sequence on which any seed has one."""
    by_seed: dict[int, dict[tuple[str, str], float]] = {}
    for result in results:
        value = result.values.get(metric)
        if value is not None and math.isfinite(value):
            by_seed.setdefault(result.seed, {})[result.row, result.sequence] = value
    places = {place for values in by_seed.values() for place in values}
    means = [
        statistics.fmean(values.values()) for values in by_seed.values() if values.keys() == places
    ]
    if not means:
        return None
    deviation = statistics.stdev(means) if len(means) > 1 else None
    sequences = frozenset(sequence for _, sequence in places)
    return Figure(statistics.fmean(means), deviation, len(means), sequences)


def _difference(full: MeasuredRow, other: MeasuredRow, metric: str) -> float:
    """How much better `other` is than `full`; 0 if the difference is not known or not significant."""
    a, b = full.figures.get(metric), other.figures.get(metric)
    if a is None or b is None or a.deviation is None or b.deviation is None:
        return 0.0
    if (a.seeds, a.sequences) != (b.seeds, b.sequences):  # one may be harder than the others
        return 0.0
    better = (b.mean - a.mean) * _sign(metric)
    return better if abs(better) > math.hypot(a.deviation, b.deviation) else 0.0


def _paper_difference(full: MeasuredRow, other: MeasuredRow, metric: str) -> float:
    if metric not in full.paper or metric not in other.paper:
        return 0.0
    return (other.paper[metric] - full.paper[metric]) * _sign(metric)


def _sign(metric: str) -> float:
    return 1.0 if metric in HIGHER_IS_BETTER else -1.0


def _text(figure: Figure) -> str:
    return f"{figure.mean:.3g}" + ("" if figure.deviation is None else f" ± {figure.deviation:.2g}")


def rich_table(title: str, rows: Sequence[MeasuredRow], metrics: Sequence[str]) -> Table:
    """The table for the terminal: mean ± deviation in each cell, the paper's number below."""
    shown = _shown(rows, metrics)
    table = Table("row", title=title, caption="below: the paper")
    for metric in shown:
        table.add_column(_HEADS[metric][0], no_wrap=True)
    for row in rows:
        cells = [
            Text.assemble(_ours(row, m), "\n", (_paper(row, m), "dim"))
            if row.paper
            else _ours(row, m)
            for m in shown
        ]
        table.add_row(_title(row), *cells)
    return table


def markdown_table(rows: Sequence[MeasuredRow], metrics: Sequence[str]) -> str:
    """The table as markdown: mean ± deviation, the paper's number in brackets."""
    shown = _shown(rows, metrics)
    head = ["row", *(_HEADS[m][0] for m in shown)]
    lines = [head, ["---"] * len(head)]
    for row in rows:
        cells = []
        for metric in shown:
            paper = _paper(row, metric)
            cells.append(_ours(row, metric) + (f" ({paper})" if paper else ""))
        lines.append([_title(row), *cells])
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _shown(rows: Sequence[MeasuredRow], metrics: Sequence[str]) -> list[str]:
    """Metrics with at least one number."""
    return [m for m in metrics if any(m in row.figures or m in row.paper for row in rows)]


def _title(row: MeasuredRow) -> str:
    name, title = row.row.name, row.row.title
    text = title if name in (title, "mean", "full") else f"({name}) {title}"
    return f"{text} ({row.note})" if row.note else text


def _ours(row: MeasuredRow, metric: str) -> str:
    figure = row.figures.get(metric)
    if figure is None:
        return "-"
    digits = _HEADS[metric][1]
    text = f"{figure.mean:.{digits}f}"
    if figure.deviation is not None:
        text += f" ± {figure.deviation:.{digits}f}"
    count = len(figure.sequences)
    return text if count == row.sequences else f"{text}, {count} of {row.sequences} sequences"


def _paper(row: MeasuredRow, metric: str) -> str:
    return f"{row.paper[metric]:g}" if metric in row.paper else ""
