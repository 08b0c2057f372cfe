"""Reads and writes rows as Parquet files; apart, as the manifest and the table of results share it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

from hsslam_node.durable_file import durable_file


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]], columns: Mapping[str, type]) -> None:
    """Write a file in one step; `columns`: name and type (int, float or str) of each column.

    Raises:
        OSError: the file cannot be written.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    kinds = {int: pa.int64(), float: pa.float64(), str: pa.string()}
    schema = pa.schema([(name, kinds[kind]) for name, kind in columns.items()])
    table = pa.Table.from_pylist(rows, schema=schema)
    with durable_file(path) as partial:
        pq.write_table(table, partial, compression="zstd")


def read_rows(source: Path | BinaryIO) -> list[dict[str, Any]]:
    """All rows of a file.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is not Parquet.
    """
    import pyarrow.parquet as pq

    with pq.ParquetFile(source) as file:  # pq.read_table may import pandas, which takes 1 s
        return file.read().to_pylist()
