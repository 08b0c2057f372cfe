"""What the driver makes of attempts: rows, another attempt, an end in order."""

import dataclasses
import json
import os
import pty
import sys
from pathlib import Path

import pytest

from hsslam_batch.attempt.commit import all_settled, commit, settled
from hsslam_batch.cluster.batch_run import BatchRun, Stop, work_words
from hsslam_batch.cluster.board import Board
from hsslam_batch.cluster.drive import Try
from hsslam_batch.cluster.task import TaskResult
from hsslam_batch.options import RunOptions, WorkOptions
from hsslam_batch.plan import tried
from hsslam_batch.plan.batch import Batch
from hsslam_batch.plan.log import read_manifest
from hsslam_batch.plan.read_batch import read_batch
from hsslam_batch.results.progress import PROGRESS, BatchProgress
from hsslam_batch.results.tally import Tally
from hsslam_services.commands.cli import parse_options
from tests.batch.object_store import BUCKET, object_store, reach
from tests.batch.outcomes import outcome, planned, run_folder
from tests.until import until


def _run(batch: Batch, pool: Board) -> BatchRun:
    logs = read_manifest(batch.out)
    progress = BatchProgress(batch, Tally(logs, []))
    return BatchRun(batch, logs, 1, pool, progress, Stop())


def test_attempts_become_rows_or_other_attempts(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    batch = planned(tmp_path / "out", frames=(100, 200, 300))
    run = _run(batch, Board())
    with run.progress:
        assert run.judge(Try(0), TaskResult(outcome(batch, 0))) is None
        died = TaskResult(trouble="its node died", is_lost=True, node_id="node1")
        assert run.judge(Try(1), died) == Try(1, 2, not_on="node1")
        assert run.judge(Try(1, 2), died) is None  # one retry
        bad = outcome(batch, 2, "bad input", reason="no log")
        assert run.judge(Try(2), TaskResult(bad)) is None
        assert run.judge(Try(2), TaskResult(is_begun=False)) is None
    row = settled(batch, "id1")
    assert row and (row.kind, row.attempt, row.reason) == ("lost", 2, "its node died")
    assert run.progress.tally.line() == "1 done, 2 failed, 0 left; 600 of 600 frames"
    assert capfd.readouterr().err == "log1: lost: its node died\nlog2: bad input: no log\n"
    lines = [json.loads(line) for line in (batch.out / PROGRESS).read_text().splitlines()]
    events = [line["event"] for line in lines]
    assert events == ["begin", "done", "again", "failed", "failed", "end"]
    assert lines[2]["reason"] == "its node died" and lines[-1]["left"] == 0


def test_a_log_whose_node_has_no_memory_left_is_tried_again_and_has_a_kind_of_its_own(
    tmp_path: Path,
):
    batch = planned(tmp_path / "out")
    run = _run(batch, Board())
    killed = TaskResult(
        trouble="Ray killed it", is_lost=True, is_out_of_memory=True, node_id="node1"
    )
    assert run.judge(Try(1), killed) == Try(1, 2, not_on="node1")
    assert run.judge(Try(1, 2), killed) is None
    row = settled(batch, "id1")
    assert row and (row.kind, row.attempt) == ("out of memory", 2)


def test_a_worker_that_died_after_its_commit_has_done_the_log(tmp_path: Path):
    batch = planned(tmp_path / "out")
    commit(batch, outcome(batch, 0), run_folder(batch, 0))
    run = _run(batch, Board())
    assert run.judge(Try(0), TaskResult(trouble="its worker died", is_lost=True)) is None
    assert run.progress.tally.done == 1


def test_a_store_that_is_away_fails_no_log_and_ends_the_batch_in_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
):
    with object_store() as (address, _), monkeypatch.context() as there:
        there.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
        there.setattr(tried, "_FIRST_WAIT_S", 0.01)
        reach(address, there)
        url = f"s3://{BUCKET}/out"
        batch = planned(tmp_path / "out", frames=(100,) * 6, url=url)
        commit(batch, outcome(batch, 5), run_folder(batch, 5))
        run = _run(batch, Board())
        with run.progress:
            reach("http://127.0.0.1:9", there)
            run.batch = dataclasses.replace(batch)  # a connection of its own
            died = TaskResult(trouble="its node died", is_lost=True, node_id="node1")
            lack = TaskResult(trouble="no route to the store", is_unavailable=True)
            assert run.judge(Try(0), died) == Try(0, 2, not_on="node1")
            assert run.judge(Try(0, 2), died) is run.judge(Try(1, 2), lack) is None
            assert run.judge(Try(2), lack) == Try(2, 2)
            assert not run.stop.is_asked()
            reach(address, there)
            run.batch = dataclasses.replace(batch)
            assert run.judge(Try(5), died) is None and run.progress.tally.done == 1
            assert run.judge(Try(2, 2), lack) is run.judge(Try(3, 2), lack) is None
            assert not run.stop.is_asked()  # the store has answered meanwhile
            assert run.judge(Try(4, 2), lack) is None and run.stop.is_asked()
        tally = run.progress.tally
        assert (tally.done, tally.failed, tally.left) == (1, 0, 5)
        assert all_settled(batch, run.logs).keys() == {"id5"}
    said = capfd.readouterr().err.splitlines()
    assert said[0].startswith(f"log0: unavailable: its node died; not written: {url}/")
    assert said[1] == "log1: unavailable: no route to the store"
    assert said[-1].startswith("error: 3 logs one after the other could not be fetched, or their")
    events = [json.loads(line) for line in (batch.out / PROGRESS).read_text().splitlines()]
    assert [event["event"] for event in events].count("left") == 5


def test_once_it_is_asked_to_stop_the_board_is_closed(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    batch = planned(tmp_path / "out")
    board = Board()
    run = _run(batch, board)
    assert board.begin(0, "node")
    board.progress(0, 40)
    with run.progress:
        run.look()
        assert run.progress.tally.frames_done == 40
        run.stop.ask()
        run.look()
        run.look()
    assert not board.begin(1, "node")
    assert capfd.readouterr().err.count("no more logs start") == 1
    assert board.end(0) == "node" and board.end(0) == ""


def test_other_code_fails_no_log_and_ends_the_batch(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    batch = planned(tmp_path / "out")
    board = Board()
    run = _run(batch, board)
    refused = TaskResult(trouble="other code", is_begun=False)
    with run.progress:
        assert run.judge(Try(0), refused) is run.judge(Try(1, 2), refused) is None
        run.look()
    assert run.stop.is_asked() and not board.begin(2, "node")
    assert run.progress.tally.left == 3 and settled(batch, "id0") is None
    said = capfd.readouterr().err.splitlines()
    assert said[0] == "error: other code" and said[1].startswith("no more logs start, running")
    assert len(said) == 2


def test_messages_that_nobody_reads_end_no_batch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The reader of stderr is gone, as `tee` after a Ctrl-C that both have heard."""
    batch = planned(tmp_path / "out", frames=(100, 200))
    readable, writable = os.pipe()
    os.close(readable)
    with os.fdopen(writable, "w") as stderr, monkeypatch.context() as unread:
        unread.setattr(sys, "stderr", stderr)
        run = _run(batch, Board())
        with run.progress:
            _fail_stop_and_do(run, batch)
    assert (run.progress.tally.done, run.progress.tally.failed) == (1, 1)


def _fail_stop_and_do(run: BatchRun, batch: Batch) -> None:
    """One log fails, the batch is asked to stop, and a log that was running is done."""
    bad = outcome(batch, 0, "bad input", reason="no log")
    assert run.judge(Try(0), TaskResult(bad)) is None
    run.stop.ask()
    run.look()
    assert run.judge(Try(1), TaskResult(outcome(batch, 1))) is None


def test_a_terminal_that_goes_away_ends_no_batch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """As of an ssh that drops, while the bar is shown."""
    batch = planned(tmp_path / "out", frames=(100, 200))
    ours, theirs = pty.openpty()
    monkeypatch.setenv("TERM", "xterm")
    with os.fdopen(theirs, "w") as stderr, monkeypatch.context() as unread:
        unread.setattr(sys, "stderr", stderr)
        run = _run(batch, Board())
        with run.progress:
            run.look()
            until(lambda: b"0 done" in os.read(ours, 10_000))
            os.close(ours)
            _fail_stop_and_do(run, batch)
    assert (run.progress.tally.done, run.progress.tally.failed) == (1, 1)


def test_an_edit_that_breaks_the_command_itself_fails_no_log(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    """It cannot say itself that the code is another: Python ends it before."""
    batch = planned(tmp_path / "out")
    broken = TaskResult(trouble="hsslam-batch work ended with exit code 1: ImportError: no module")
    assert _run(batch, Board()).judge(Try(0), broken) == Try(0, 2)  # a crash, with the same code
    file = batch.out / "batch.json"
    file.write_text(file.read_text().replace(batch.about.digest, "0123"))
    run = _run(read_batch(str(batch.out)), Board())
    with run.progress:
        assert run.judge(Try(1), broken) is run.judge(Try(2), broken) is None
    assert run.stop.is_asked() and settled(batch, "id1") is None
    said = capfd.readouterr().err
    assert said.startswith(f"error: {batch.out}: was planned with ")
    assert " (0123), this is " in said and said.count("\n") == 1


def test_work_gets_the_limits_of_run(tmp_path: Path):
    batch = planned(tmp_path / "out")
    options = RunOptions(
        out=str(batch.out), memory_gb=3.5, timeout_s=60.0, scratch=Path("/scratch"), retries=1
    )
    logs = read_manifest(batch.out)
    words = work_words(batch, logs, options, Try(2, 3))
    work = parse_options(WorkOptions, "hsslam-batch work", words)
    assert (work.out, work.index, work.id, work.attempt) == (str(batch.out), 2, "id2", 3)
    assert work.retries == 1
    assert (work.memory_gb, work.timeout_s, work.scratch) == (3.5, 60.0, Path("/scratch"))
    assert work.patience_s == options.patience_s == 300
    assert "--timeout" not in work_words(batch, logs, RunOptions(out=str(batch.out)), Try(0))
