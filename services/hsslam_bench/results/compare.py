"""Compares two result files as ratios."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rich.table import Column, Table
from rich.text import Text

from hsslam_bench.checks.check import NO_FIGURE, Better, Row
from hsslam_bench.results.report import Report

_NOTABLE = 0.05  # relative change that counts as better or worse


@dataclass(frozen=True)
class Pair:
    """One number that both results have."""

    name: str  # of the row, then the path of the number in its values
    before: float
    after: float
    better: Better = ""

    @property
    def ratio(self) -> float:
        """After over before; infinite if only `before` is zero."""
        if self.before == self.after:
            return 1.0
        return self.after / self.before if self.before else math.inf

    @property
    def is_better(self) -> bool | None:
        """Whether B is notably better (False: notably worse; None: neither)."""
        change = self.after - self.before
        if not self.better or not change or abs(change) < _NOTABLE * abs(self.before):
            return None
        return (change < 0) == (self.better == "lower")


def pairs(before: Report, after: Report) -> list[Pair]:
    """The numbers that both have: the figure of a row, or all its values if it has no figure."""
    return [pair for old, new in _in_both(before, after) for pair in _pairs_of(old, new)]


def comparison(before: Report, after: Report) -> Table:
    """The pairs as a table for the terminal."""
    table = Table(Column("row", no_wrap=True), "A", "B", "B / A", "")
    for pair in pairs(before, after):
        good = pair.is_better
        verdict = "" if good is None else "better" if good else "worse"
        style = "" if good is None else "green" if good else "red"
        numbers = (f"{pair.before:.4g}", f"{pair.after:.4g}")
        table.add_row(pair.name, *numbers, Text(f"{pair.ratio:.2f}", style), Text(verdict, style))
    return table


def circumstances(before: Report, after: Report) -> list[str]:
    """Lines about commit and time of both results, and about differences that make ratios misleading."""
    lines = [f"{name}: {_title(found)}" for name, found in (("A", before), ("B", after))]
    for name, own, other in (("A", before, after), ("B", after, before)):
        only = sorted(_measured(own) - _measured(other))
        if only:
            lines.append(f"only in {name}: {', '.join(only)}")
    if before.machine.cpu != after.machine.cpu or before.machine.cores != after.machine.cores:
        lines.append("measured on different machines: ratios may mislead")
    if before.protocol.get("quick") or after.protocol.get("quick"):
        lines.append("measured with --quick: ratios may mislead")
    extra = [" ".join(found.protocol.get("extra_options", [])) for found in (before, after)]
    if extra[0] != extra[1]:
        shown = (words or "none" for words in extra)
        lines.append("options of hsslam-serve: A {}, B {}: ratios may mislead".format(*shown))
    return lines + [line for pair in _in_both(before, after) for line in _differences(*pair)]


def _in_both(before: Report, after: Report) -> list[tuple[Row, Row]]:
    """The rows that both have measured."""
    old = {row.name: row for row in before.rows}
    names = _measured(before) & _measured(after)
    return [(old[row.name], row) for row in after.rows if row.name in names]


def _measured(found: Report) -> set[str]:
    return {row.name for row in found.rows if row.verdict not in NO_FIGURE}


def _differences(old: Row, new: Row) -> Iterator[str]:
    """Lines about differences that a ratio hides: definition, verdict, or a figure that only one has."""
    for name in ("what", "bound", "version"):
        own, other = getattr(old, name), getattr(new, name)
        if own != other:
            yield f"{new.name}: {name} differs: A {own or 'none'}, B {other or 'none'}"
    if old.verdict != new.verdict or (old.figure is None) != (new.figure is None):
        yield f"{new.name}: A {old.verdict}, {old.measured}; B {new.verdict}, {new.measured}"


def _pairs_of(old: Row, new: Row) -> Iterator[Pair]:
    if old.figure is not None and new.figure is not None:
        yield Pair(new.name, old.figure, new.figure, new.better)
        return
    before, after = dict(_numbers(old.values)), dict(_numbers(new.values))
    for path, value in after.items():
        if path in before and (value or before[path]):
            yield Pair(f"{new.name} {' '.join(path)}", before[path], value)


def _numbers(value: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], float]]:
    """All numbers in a nested value, each with its path of names and indices."""
    if isinstance(value, bool):
        return
    if isinstance(value, int | float):
        yield path, float(value)
    elif isinstance(value, Mapping):
        for name, item in value.items():
            yield from _numbers(item, (*path, str(name)))
    elif isinstance(value, Sequence) and not isinstance(value, str):
        for number, item in enumerate(value):
            yield from _numbers(item, (*path, str(number)))


def _title(found: Report) -> str:
    return f"{found.commit or 'unknown'}, {found.time}"
