"""Rows and result files as the benchmark writes them."""

import dataclasses
from pathlib import Path

from hsslam_bench.checks.catalogue import catalogue
from hsslam_bench.checks.check import Row, unmeasured
from hsslam_bench.results.report import read_report, report, write_report
from hsslam_bench.runs.session import Session


def row_of(name: str, measured: str = "12", verdict="measured") -> Row:
    """A row of the catalogue that was measured so."""
    (check,) = (check for check in catalogue() if check.name == name)
    return dataclasses.replace(unmeasured(check), measured=measured, verdict=verdict)


def stored(path: Path, *rows: Row) -> Path:
    """A result file of these rows."""
    write_report(path, report(Session(path.parent, path.parent), rows))
    assert read_report(path).rows == rows
    return path
