"""The counts of a batch and its exit code, which is that of `hsslam-batch run` in the same state."""

from pathlib import Path

import pytest

from hsslam_batch.attempt.commit import commit, settle_failed
from hsslam_batch.cluster.command import run_command
from hsslam_batch.results.status import status_command
from tests.batch.outcomes import outcome, planned, run_folder


def test_the_exit_code_is_1_while_logs_are_left_then_3_if_some_failed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    batch = planned(tmp_path / "out", frames=(100, 200))
    words = [str(batch.out)]
    settle_failed(batch, outcome(batch, 1, "bad input", reason="no log"))
    assert status_command(words) == 1
    said = capsys.readouterr()
    assert said.out == "2 logs: 0 done, 1 failed, 1 left; 0 of 300 frames\n"
    assert said.err == "log1: bad input: no log (attempt 1)\n"
    commit(batch, outcome(batch, 0, frames=100), run_folder(batch, 0))
    assert status_command(words) == run_command(words) == 3
    commit(batch, outcome(batch, 1, frames=200), run_folder(batch, 1))
    assert status_command(words) == run_command(words) == 0


def test_logs_of_unknown_length_count_as_those_that_are_done(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    batch = planned(tmp_path / "out", frames=(0, 0, 0))
    assert status_command([str(batch.out)]) == 1
    assert capsys.readouterr().out == "3 logs: 0 done, 0 failed, 3 left; 0 frames\n"
    commit(batch, outcome(batch, 0, frames=20), run_folder(batch, 0))
    assert status_command([str(batch.out)]) == 1
    assert capsys.readouterr().out == "3 logs: 1 done, 0 failed, 2 left; 20 of 60 frames\n"
