"""A measured table for people: on the terminal, and as markdown."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from rich.table import Table
from rich.text import Text

from hsslam_node.services.bench.tables.figures import MeasuredRow

_HEADS: Mapping[str, tuple[str, int]] = MappingProxyType(  # title, digits
    {
        "accuracy_cm": ("acc. cm", 2),
        "completion_cm": ("comp. cm", 2),
        "completion_pct": ("comp. %", 2),
        "depth_l1_cm": ("depth L1 cm", 2),
        "ate_cm": ("ATE cm", 3),
        "ate_mean_cm": ("ATE mean cm", 3),
        "ate_online_cm": ("ATE online cm", 3),
        "lost": ("lost", 1),
        "model_mib": ("model MiB", 1),
        "fps": ("frames/s", 2),
    }
)


def rich_table(title: str, rows: Sequence[MeasuredRow], metrics: Sequence[str]) -> Table:
    """Mean ± deviation in each cell, the paper's number below it."""
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
    """Mean ± deviation, the paper's number in brackets."""
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
    """Metrics of which there is a number."""
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
    return text if figure.deviation is None else f"{text} ± {figure.deviation:.{digits}f}"


def _paper(row: MeasuredRow, metric: str) -> str:
    return f"{row.paper[metric]:g}" if metric in row.paper else ""
