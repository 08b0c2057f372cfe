"""The costs of logs: core seconds a minute of log, for each kind of source and for all."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rich.table import Table

_ALL = "all"


@dataclass(frozen=True)
class Cost:
    """Sums over the done logs of one kind of source; `log_s`: recorded time, by the sensor clock."""

    source: str
    logs: int
    frames: int
    log_s: float
    core_s: float
    wall_s: float

    @property
    def core_s_a_minute(self) -> float:
        """Core seconds a minute of log."""
        return 60 * self.core_s / self.log_s

    @property
    def wall_s_a_minute(self) -> float:
        """Wall time, s, a minute of log, if logs run one after the other."""
        return 60 * self.wall_s / self.log_s

    @property
    def core_ms_a_frame(self) -> float:
        """Core milliseconds a frame."""
        return 1e3 * self.core_s / self.frames


def costs(rows: Sequence[Mapping[str, Any]]) -> list[Cost]:
    """Costs by kind of source, then of all, from rows of runs.parquet; skips logs of unknown length."""
    done = [row for row in rows if row["kind"] == "done" and row["log_s"]]
    kinds = sorted({_kind(row) for row in done})
    found = [_cost(kind, [row for row in done if _kind(row) == kind]) for kind in kinds]
    return [*found, _cost(_ALL, done)] if len(kinds) > 1 else found


def cost_table(found: Sequence[Cost]) -> Table:
    """The costs as a table for the terminal."""
    per_log = ("core s a minute", "seconds a minute", "core ms a frame")
    table = Table("source", "logs", "minutes of log", "core time, s", *per_log)
    for cost in found:
        minutes, core_s = f"{cost.log_s / 60:.1f}", f"{cost.core_s:.0f}"
        of_log = (cost.core_s_a_minute, cost.wall_s_a_minute, cost.core_ms_a_frame)
        table.add_row(cost.source, str(cost.logs), minutes, core_s, *(f"{x:.0f}" for x in of_log))
    return table


def _kind(row: Mapping[str, Any]) -> str:
    return row["source"].partition(":")[0]


def _cost(source: str, rows: Sequence[Mapping[str, Any]]) -> Cost:
    columns = ("frames", "log_s", "core_s", "wall_s")
    sums = {column: sum(row[column] for row in rows) for column in columns}
    return Cost(source, len(rows), **sums)
