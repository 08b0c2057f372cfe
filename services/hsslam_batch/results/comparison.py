"""Compares two batches log by log: by which factor each figure changed, which logs got worse."""

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

Row = Mapping[str, Any]  # of runs.parquet


@dataclass(frozen=True)
class Figure:
    """A value of a row to compare; less is better. Differences up to `least` are ignored."""

    column: str
    title: str
    scale: float  # from the value to the unit of the title
    least: float
    is_rest: bool = False  # the value is what the column, a share, lacks to 1

    def value(self, row: Row) -> float | None:
        """The value of a row; None if it is missing or not finite."""
        found = row[self.column]
        if found is None or not math.isfinite(found):
            return None
        return 1.0 - found if self.is_rest else found


FIGURES = (
    Figure("ate_m", "ATE, cm", 1e2, 5e-4),
    Figure("mesh_accuracy_m", "mesh accuracy, cm", 1e2, 1e-3),
    Figure("mesh_completion", "mesh missing, %", 1e2, 1e-2, is_rest=True),
    Figure("lost", "lost frames", 1.0, 1.0),
    Figure("core_s", "core time, s", 1.0, 5.0),
    Figure("memory_mb", "memory, MB", 1.0, 100.0),
)


@dataclass(frozen=True)
class Pair:
    """A log with a value in both batches."""

    name: str
    before: float
    after: float

    @property
    def ratio(self) -> float:
        """After over before; infinite if only `before` is zero."""
        if self.before == self.after:
            return 1.0
        return self.after / self.before if self.before > 0 else math.inf


@dataclass(frozen=True)
class Change:
    """One figure over all logs that have it in both batches. `worse`: the worst ratio first.

    `gone`: names of logs that are done in both batches but have the figure only in the first.
    """

    figure: Figure
    pairs: Sequence[Pair]
    worse: Sequence[Pair]
    better: int
    gone: Sequence[str]

    @property
    def median_ratio(self) -> float | None:
        """Median of the ratios, without logs whose values are both zero; None without ratios."""
        ratios = [pair.ratio for pair in self.pairs if pair.before or pair.after]
        return statistics.median(ratios) if ratios else None


def compare(before: Sequence[Row], after: Sequence[Row], noise: float) -> list[Change]:
    """The change of each figure; a log counts if it changed by more than `noise`, a fraction, and `least`."""
    earlier = {row["name"]: row for row in before if row["kind"] == "done"}
    changes = []
    for figure in FIGURES:
        had = {name: v for name, old in earlier.items() if (v := figure.value(old)) is not None}
        has = {row["name"]: figure.value(row) for row in after if row["kind"] == "done"}
        both = [name for name in has if name in had]
        pairs = [Pair(n, float(had[n]), float(v)) for n in both if (v := has[n]) is not None]
        gone = [name for name in both if has[name] is None]
        worse = [pair for pair in pairs if _is_beyond(pair.before, pair.after, figure, noise)]
        better = sum(_is_beyond(pair.after, pair.before, figure, noise) for pair in pairs)
        worse.sort(key=lambda pair: (-pair.ratio, pair.name))
        changes.append(Change(figure, pairs, worse, better, gone))
    return changes


def newly_failed(before: Sequence[Row], after: Sequence[Row]) -> list[Row]:
    """Logs that are done in the first batch and failed in the second."""
    done = {row["name"] for row in before if row["kind"] == "done"}
    return [row for row in after if row["kind"] != "done" and row["name"] in done]


def worst(rows: Sequence[Row], figure: Figure, count: int) -> list[tuple[str, float]]:
    """Names and values of the logs with the largest values of a figure, without zeros and missing values."""
    known = [(row["name"], v) for row in rows if (v := figure.value(row)) is not None and v > 0]
    return sorted(known, key=lambda pair: (-pair[1], pair[0]))[:count]


def _is_beyond(small: float, large: float, figure: Figure, noise: float) -> bool:
    return large > small * (1 + noise) and large - small > figure.least
