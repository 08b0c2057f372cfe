"""Rows of lockstep runs have the same figures as tasks of Ray and one after the other."""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from hsslam_bench.checks.catalogue import catalogue
from hsslam_bench.checks.check import Row, perform
from hsslam_bench.results.report import read_report
from hsslam_bench.runs.serve_run import RunFailedError
from hsslam_bench.runs.session import Session

_TINY = (
    *("--synth.width-px", "160", "--synth.height-px", "120", "--frames", "12"),
    *("--slam.mapper.first-iterations", "20", "--slam.mapper.rays", "256"),
    *("--slam.ba.rays", "256", "--slam.mesher.final-voxel-m", "0.08"),
)


def test_rows_that_become_tasks_are_of_lockstep_runs_alone(tmp_path: Path):
    for name in ("livingroom", "kitchen", "house"):
        (tmp_path / name).mkdir()
    asked: list[Sequence[str]] = []

    def make(name: str, folder: Path, options: Sequence[str], *_: Any, **more: Any):
        assert more == {"viewer": "none", "outsider": None, "cores": None}
        asked.append(options)
        raise RunFailedError(name)

    session = Session(tmp_path, tmp_path / "runs", make=make)
    rows = [perform(check, session) for check in catalogue() if check.is_lockstep]
    assert {row.verdict for row in rows} == {"NOT MET"} and len(asked) == len(rows) > 20
    assert all(options[options.index("--pace") + 1] == "lockstep" for options in asked)


@pytest.mark.e2e
@pytest.mark.long
@pytest.mark.timeout(1800)
def test_figures_are_those_of_one_run_after_the_other(tmp_path: Path):
    def measured(name: str, *options: str) -> list[Row]:
        out = tmp_path / f"{name}.json"
        rows = ("--only", "log:messages", "ate:room-kinect", "repeat:room-kinect")
        command = [sys.executable, "-m", "hsslam_bench", "--quick", "--out", str(out), *rows]
        done = subprocess.run([*command, *options, "--", *_TINY], capture_output=True, text=True)
        assert done.returncode in (0, 1), done.stderr  # twelve frames may miss the bound
        return list(read_report(out).rows)

    alone, as_tasks = measured("alone"), measured("tasks", "--address", "local")
    assert as_tasks == alone and len(alone) == 3
    poses = [tmp_path / name / "lockstep-room-kinect-seed0" for name in ("alone", "tasks")]
    assert len({(folder / "trajectory.txt").read_bytes() for folder in poses}) == 1
