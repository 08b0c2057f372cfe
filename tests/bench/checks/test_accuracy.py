"""A bound that is made of another run's error is not met if that run has no error."""

import json
import math
from pathlib import Path
from typing import Any

import pytest

from hsslam_bench.checks.catalogue import catalogue
from hsslam_bench.checks.check import Row, perform, select
from hsslam_bench.runs.run_log import LogContent
from hsslam_bench.runs.serve_run import ServeRun
from hsslam_bench.runs.session import Session

_FINAL = {"rmse_m": 0.001, "scored": 9, "expected": 9}


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Folders of sequences without frames; nothing is run, so nothing reads them."""
    for name in ("livingroom", "house", "runs/distorted-room/lens"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "runs/distorted-room/lens/groundtruth.txt").touch()
    return tmp_path


def _row(data: Path, name: str, unscored: str = "") -> Row:
    """A row of runs that are equally good; `unscored`: the one that was not evaluated."""

    def make(run: str, folder: Path, *_: Any, **__: Any) -> ServeRun:
        evaluation = {} if run == unscored else {"ate": {"final": _FINAL}}
        summary = {"frames": {"in": 9, "tracked": 9, "lost": 0}, "evaluation": evaluation}
        return ServeRun(run, folder, (), 0, 1.0, 0, "", summary, LogContent({}), "")

    (check,) = select(catalogue(), [name])
    return perform(check, Session(data, data / "runs", quick=True, make=make))


@pytest.mark.parametrize(
    ("name", "reference"),
    [
        ("lens:room", "poses-plain-seed0"),
        ("odometry:covered:room", "poses-room-free-alone-seed0"),
        ("odometry:seeing:room", "poses-room-free-alone-seed0"),
        ("stride:livingroom:2", "poses-lockstep-livingroom-seed0"),
        ("refinement:lockstep:house", "poses-lockstep-house-seed0-unrefined"),
        ("lost:apartment", "dark-0-0-apartment-seed0"),
        ("realtime:room:ate", "lockstep-room-seed0"),
    ],
)
def test_a_run_without_ate_makes_no_bound(data: Path, name: str, reference: str):
    assert _row(data, name).verdict == "ok"
    row = _row(data, name, unscored=reference)
    told = f"{reference} has no ATE: 0 frames are scored"
    assert (row.verdict, row.measured) == ("NOT MET", told)


@pytest.mark.parametrize(("theirs_m", "verdict"), [(0.002, "ok"), (math.nan, "NOT MET")])
def test_a_preset_without_ate_makes_no_bound(data: Path, theirs_m: float, verdict: str):
    session = Session(data, data / "runs")
    for preset, rmse_m in (("realtime", 0.001), ("eslam", theirs_m)):
        key = ("hsslam_bench.scripts.preset_speed", preset, session.source("house"), "100")
        session.outputs[key] = json.dumps({"rmse_m": rmse_m, "lost": 0})
    (check,) = select(catalogue(), ["baselines:eslam:ate"])
    assert perform(check, session).verdict == verdict
