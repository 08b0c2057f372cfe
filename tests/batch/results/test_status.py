"""The counts of a batch and its exit code, which is that of `hsslam-batch run` in the same state."""

import dataclasses
from pathlib import Path

import pytest

from hsslam_batch.attempt.commit import commit, settle_failed
from hsslam_batch.attempt.serve_log import Terms, serve_log
from hsslam_batch.attempt.watched_process import Limits
from hsslam_batch.cluster.command import run_command
from hsslam_batch.plan.log import read_manifest, write_manifest
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


def test_a_log_between_its_attempts_is_left(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """As after Ctrl-C: the next `run` makes the further attempts."""
    batch = planned(tmp_path / "out", frames=(100,))
    log = dataclasses.replace(read_manifest(batch.out)[0], place="s3://fleet/log0")
    write_manifest(batch.out, [log])
    at_once = Limits(timeout_s=1e-6)
    for attempt, exit_code in ((1, 1), (2, 3)):
        outcome = serve_log(batch, log, Terms(attempt, 2, at_once))
        assert outcome.kind == "timeout"  # which gets one more attempt
        assert status_command([str(batch.out)]) == exit_code
    said = capsys.readouterr()
    counts = [line.partition(";")[0] for line in said.out.splitlines()]
    assert counts == ["1 logs: 0 done, 0 failed, 1 left", "1 logs: 0 done, 1 failed, 0 left"]
    assert said.err == "log0: timeout: stopped: took longer than 1e-06 s (--timeout) (attempt 2)\n"
    assert run_command([str(batch.out)]) == 3  # and nothing is left to run


def test_logs_of_unknown_length_count_as_those_that_are_done(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    batch = planned(tmp_path / "out", frames=(0, 0, 0))
    assert status_command([str(batch.out)]) == 1
    assert capsys.readouterr().out == "3 logs: 0 done, 0 failed, 3 left; 0 frames\n"
    commit(batch, outcome(batch, 0, frames=20), run_folder(batch, 0))
    assert status_command([str(batch.out)]) == 1
    assert capsys.readouterr().out == "3 logs: 1 done, 0 failed, 2 left; 20 of 60 frames\n"
