"""Query the table of a batch for the cost of logs and the most lost frames, with one of three libraries.

    python examples/ask_runs.py tonight/runs.parquet [pandas|duckdb|polars]

Costs are core seconds a minute of log, for each kind of source. Install the library that you name.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

Answer = tuple[list[tuple[str, float]], list[tuple[str, int]]]  # cost by source; name, lost frames
_WORST = 3


def ask_pandas(table: str) -> Answer:
    """pandas: the table is a DataFrame in memory."""
    import pandas as pd

    runs: Any = pd.read_parquet(table)
    done = runs[runs["kind"] == "done"].assign(source=lambda d: d["source"].str.split(":").str[0])
    sums = done.groupby("source")[["core_s", "log_s"]].sum()
    costs = 60 * sums["core_s"] / sums["log_s"]
    worst = done.sort_values(["lost", "name"], ascending=[False, True]).head(_WORST)
    return list(costs.items()), list(zip(worst["name"], worst["lost"], strict=True))


def ask_duckdb(table: str) -> Answer:
    """DuckDB: SQL on the file, or on s3://BUCKET/BATCH/runs.parquet."""
    import duckdb

    done = f"SELECT *, split_part(source, ':', 1) AS sort FROM '{table}' WHERE kind = 'done'"
    costs = f"SELECT sort, 60 * sum(core_s) / sum(log_s) FROM ({done}) GROUP BY sort ORDER BY sort"
    worst = f"SELECT name, lost FROM ({done}) ORDER BY lost DESC, name LIMIT {_WORST}"
    ask = duckdb.connect().execute
    return ask(costs).fetchall(), ask(worst).fetchall()


def ask_polars(table: str) -> Answer:
    """Polars: a lazy scan, which reads the columns that are asked for."""
    import polars as pl

    done = pl.scan_parquet(table).filter(pl.col("kind") == "done")
    source = pl.col("source").str.split(":").list.first()
    cost = 60 * pl.col("core_s").sum() / pl.col("log_s").sum()
    costs = done.group_by(source).agg(cost.alias("cost")).sort("source")
    worst = done.sort(["lost", "name"], descending=[True, False]).head(_WORST)
    return costs.collect().rows(), worst.select("name", "lost").collect().rows()


LIBRARIES: dict[str, Callable[[str], Answer]] = {
    "pandas": ask_pandas,
    "duckdb": ask_duckdb,
    "polars": ask_polars,
}


def main(table: str, library: str = "pandas") -> None:
    """Print the answers."""
    if "://" not in table and not Path(table).is_file():
        sys.exit(f"error: {table}: no such file: expected runs.parquet of hsslam-batch report")
    if library not in LIBRARIES:
        sys.exit(f"error: {library}: expected {', '.join(LIBRARIES)}")
    costs, worst = LIBRARIES[library](table)
    for source, core_s in costs:
        print(f"{source}: {core_s:.1f} core seconds a minute of log")
    for name, lost in worst:
        print(f"{name}: {lost} frames lost")


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3) or sys.argv[1:] == ["--help"]:
        sys.exit(__doc__)
    main(*sys.argv[1:])
