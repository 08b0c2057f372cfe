"""Agreement of frames is only as good as the share of frames that it is of."""

import json
from pathlib import Path
from typing import Any

import pytest

from hsslam_bench.checks.catalogue import catalogue
from hsslam_bench.checks.check import perform, select
from hsslam_bench.runs.run_log import LogContent
from hsslam_bench.runs.serve_run import ServeRun
from hsslam_bench.runs.session import Session


@pytest.mark.parametrize(
    ("pairs", "lost", "verdict"),
    [(35, 0, "ok"), (34, 0, "ok"), (20, 0, "NOT MET"), (35, 1, "NOT MET")],
)
@pytest.mark.parametrize("name", ["faithful:kitchen:depth", "faithful:kitchen:color"])
def test_pairs_that_the_given_poses_have_are_not_left_out(
    tmp_path: Path, name: str, pairs: int, lost: int, verdict: str
):
    (tmp_path / "kitchen").mkdir()
    good = {"gap_frames": 30, "depth_median_m": 0.008, "one_minus_ncc": 0.02, "possible": 35}
    found = {"estimated": [good | {"pairs": pairs}], "given": [good | {"pairs": 35}]}

    def make(run: str, folder: Path, *_: Any, **__: Any) -> ServeRun:
        key = ("hsslam_bench.runs.run_score", str(folder), "consistency")
        session.outputs[key] = json.dumps({"consistency": found})
        summary = {"frames": {"in": 380, "lost": lost}}
        return ServeRun(run, folder, (), 0, 1.0, 0, "", summary, LogContent({}), "")

    session = Session(tmp_path, tmp_path / "runs", quick=True, make=make)
    row = perform(select(catalogue(), [name])[0], session)
    assert row.verdict == verdict
    assert f"{pairs} of 35 pairs, {lost} lost" in row.measured
