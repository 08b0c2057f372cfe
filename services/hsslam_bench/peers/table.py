"""The scores of peers as a table for the terminal, as markdown, and in one line."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from rich.table import Table

from hsslam_bench.peers.score import GAP_FRAMES, Values


@dataclass(frozen=True)
class PeerRow:
    """The scores of one system on one sequence."""

    sequence: str
    peer: str
    values: Values = field(default_factory=dict)
    error: str = ""  # last line of output if it failed


def _share(metric: str, of: str) -> Callable[[Values], str]:
    def text(values: Values) -> str:
        part, whole = values.get(metric), values.get(of)
        return "-" if part is None or whole is None else f"{part:.0f}/{whole:.0f}"

    return text


def _number(metric: str, digits: int) -> Callable[[Values], str]:
    def text(values: Values) -> str:
        value = values.get(metric)
        return "-" if value is None else f"{value:.{digits}f}"

    return text


def _mesh(before: str) -> Callable[[Values], str]:
    names = (("accuracy_cm", 2), ("completion_cm", 2), ("completion_pct", 1))
    parts = [_number(f"{before}{name}", digits) for name, digits in names]

    def text(values: Values) -> str:
        is_scored = values.get(f"{before}accuracy_cm") is not None
        return " / ".join(part(values) for part in parts) if is_scored else "-"

    return text


_COLUMNS: Mapping[str, Callable[[Values], str]] = {
    "scored": _share("scored", "expected"),
    "ATE cm": _number("ate_cm", 3),
    "RPE frame cm": _number("rpe_cm", 3),
    f"{GAP_FRAMES} frames apart mm": _number("depth_mm", 1),
    "1 - NCC": _number("one_minus_ncc", 3),
    "pairs": _share("pairs", "possible_pairs"),
    "mesh exact acc. / comp. cm / %": _mesh(""),
    "mesh lit. acc. / comp. cm / %": _mesh("lit_"),
    "frames/s": _number("fps", 1),
}


def peers_table(rows: Sequence[PeerRow]) -> Table:
    """One line for each sequence and system; "failed" replaces missing scores."""
    table = Table("sequence", "by", title="peers", title_justify="left")
    for name in _COLUMNS:
        table.add_column(name, justify="right")
    for row in rows:
        cells = [text(row.values) for text in _COLUMNS.values()]
        table.add_row(row.sequence, row.peer, *(["failed"] if row.error else cells))
    return table


def peers_markdown(rows: Sequence[PeerRow]) -> str:
    """The table as markdown, for documents."""
    head = ["sequence", "by", *_COLUMNS]
    lines = [head, ["---"] * len(head)]
    for row in rows:
        cells = [text(row.values) for text in _COLUMNS.values()]
        shown = ["failed", *[""] * (len(cells) - 1)] if row.error else cells
        lines.append([row.sequence, row.peer, *shown])
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def in_words(values: Values) -> str:
    """All known scores in one line."""
    found = {name: text(values) for name, text in _COLUMNS.items()}
    return "; ".join(f"{name} {text}" for name, text in found.items() if text != "-")
