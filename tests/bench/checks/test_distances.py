"""Which of the errors of distances have to meet the bound."""

import json
from pathlib import Path

import pytest

from hsslam_bench.checks.catalogue import catalogue
from hsslam_bench.checks.check import perform, select
from hsslam_bench.runs.session import Session

_GOOD = {
    "points": 1000, "mean_m": 0.006, "within_5cm": 0.995, "optimistic_5cm": 0.0005,
    "pessimistic_5cm": 0.002, "gradient_deg": 2.5,
}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "verdict"), [("certain", "NOT MET"), ("queried", "NOT MET"), ("all", "ok")]
)
def test_answers_of_the_map_have_the_bound_too(tmp_path: Path, name: str, verdict: str):
    (tmp_path / "house").mkdir()
    session = Session(tmp_path, tmp_path / "runs")
    errors = dict.fromkeys(("certain", "queried", "all"), _GOOD) | {
        name: _GOOD | {"optimistic_5cm": 0.002}
    }
    module, source = "hsslam_bench.free_space.run", session.source("house")
    for seed in session.seeds:
        session.outputs[module, source, str(seed), "--noise", "kinect"] = json.dumps(errors)
    (check,) = select(catalogue(), ["distances:house-kinect"])
    assert perform(check, session).verdict == verdict
