"""The example that asks the table of a batch, with each library, and the questions of docs/batch.md."""

import re
import subprocess
import sys
from pathlib import Path

import duckdb
import pytest

from hsslam_batch.attempt.commit import commit, settle_failed
from hsslam_batch.plan.log import read_manifest
from hsslam_batch.results.runs_table import write_runs
from tests.batch.outcomes import outcome, planned, run_folder
from tests.in_process import run_script
from tests.repository import ROOT

EXAMPLE = ROOT / "examples/ask_runs.py"
_ANSWER = """\
mcap: 90.0 core seconds a minute of log
log1: 7 frames lost
log0: 0 frames lost
log2: 0 frames lost
"""


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """Three logs that are done, and one that is not."""
    batch = planned(tmp_path / "tonight", frames=(100,) * 4)
    for k, (lost, core_s) in enumerate(((0, 10.0), (7, 20.0), (0, 60.0))):
        row = outcome(batch, k, frames=100, lost=lost, log_s=20.0, core_s=core_s, ate_m=0.01)
        commit(batch, row, run_folder(batch, k))
    settle_failed(batch, outcome(batch, 3, "crash", reason="killed by SIGSEGV", lost=50))
    return write_runs(batch, read_manifest(batch.out))


@pytest.mark.parametrize("library", ["pandas", "duckdb", "polars"])
def test_each_library_has_the_same_answers(table: Path, library: str):
    done = run_script(EXAMPLE, str(table), library)
    assert (done.returncode, done.stdout) == (0, _ANSWER), done.stderr


def test_bad_input_is_one_line(table: Path):
    for arguments, text in (((str(table), "excel"), "excel: expected"), (("none",), "none: no su")):
        done = run_script(EXAMPLE, *arguments)
        assert done.returncode == 1
        assert done.stderr.startswith(f"error: {text}") and done.stderr.count("\n") == 1


def test_the_questions_of_the_documents_have_answers(table: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(table.parents[1])
    blocks = dict(
        re.findall(
            r"^```(python|sql)\n((?:import|--) (?:pandas|DuckDB).*?)^```",
            (ROOT / "docs/batch.md").read_text(),
            re.M | re.S,
        )
    )
    shown = subprocess.run([sys.executable, "-c", blocks["python"]], capture_output=True, text=True)
    assert shown.returncode == 0 and "log1" in shown.stdout, shown.stderr
    first, *others = duckdb.connect().execute(blocks["sql"]).fetchall()
    assert first[:3] == ("log1", 7, 100) and len(others) == 2
