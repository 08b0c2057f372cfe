"""Rows of `hsslam-batch` are met only if all logs are done."""

import json
from pathlib import Path

import pytest

from hsslam_bench.checks.catalogue import catalogue
from hsslam_bench.checks.check import perform, select
from hsslam_bench.runs.session import Session


@pytest.mark.parametrize(("done", "verdict"), [(20, "ok"), (0, "NOT MET")])
@pytest.mark.parametrize("name", ["batch:scheduling", "batch:memory"])
def test_logs_that_are_not_done_are_not_measured(
    tmp_path: Path, name: str, done: int, verdict: str
):
    figures = {"slots": 2, "slot_ms": 9.0, "driver_ms": 2.0, "ray_ms": 7.0}
    figures |= {"logs": 20, "done": done, "memory_mb": 100.0, "last_memory_mb": 101.0}
    printed = {("hsslam_bench.batch.scheduling",): json.dumps(figures)}
    (check,) = select(catalogue(), [name])
    row = perform(check, Session(tmp_path, tmp_path, outputs=printed))
    assert row.verdict == verdict and row.measured.endswith(f"{done} of 20 logs")
