"""What `hsslam-batch run` decides before it starts Ray."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import msgspec
import pyarrow.parquet as pq
import pytest

from hsslam_batch.attempt.command import work_command
from hsslam_batch.attempt.commit import commit, settle_failed
from hsslam_batch.attempt.outcome import Line, Refused, Unavailable
from hsslam_batch.cluster.command import run_command, waiting_tries
from hsslam_batch.cluster.drive import Try
from hsslam_batch.options import RunOptions
from hsslam_batch.plan import tried
from hsslam_batch.plan.batch import Batch, OtherPlanError
from hsslam_batch.plan.lock import alone
from hsslam_batch.plan.read_batch import read_batch
from hsslam_batch.results.runs_table import read_runs
from hsslam_batch.results.status import status_command
from hsslam_node.errors import UserError
from tests.batch.object_store import BUCKET, Faults, faulty, object_store, reach
from tests.batch.outcomes import outcome, planned, run_folder


@pytest.fixture
def batch(tmp_path: Path) -> Batch:
    """A log that is done, one whose input is bad, none that is left."""
    batch = planned(tmp_path / "out", frames=(100, 200))
    commit(batch, outcome(batch, 0), run_folder(batch, 0))
    settle_failed(batch, outcome(batch, 1, "bad input"))
    return batch


def test_where_nothing_is_left_ray_is_not_started(
    batch: Batch, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setitem(sys.modules, "ray", None)  # cannot be imported
    assert run_command([str(batch.out)]) == 3
    assert capsys.readouterr().out == "1 done, 1 failed, 0 left; 300 of 300 frames\n"
    assert (batch.out / "runs.parquet").exists()
    with pytest.raises(ModuleNotFoundError):
        run_command([str(batch.out), "--failed"])


def test_the_same_again_asks_a_store_for_each_row_once(tmp_path: Path, monkeypatch, capsys):
    """Logs without a row cost no request of their own: listings say that there is none."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    faults, url = Faults(1000, of_all=True), f"s3://{BUCKET}/out"
    with object_store() as (server, _), faulty(server, faults) as address:
        reach(address, monkeypatch)
        batch = planned(tmp_path / "out", frames=(100,) * 9, url=url)
        for k in range(2):
            commit(batch, outcome(batch, k), run_folder(batch, k))
        for k in range(2, 4):
            settle_failed(batch, outcome(batch, k, "bad input"))
        faults.ranges.clear()
        assert status_command([url]) == 1
        assert _rows_asked_for(faults) == ["id0", "id1", "id2", "id3"]
        planned(tmp_path / "out", frames=(100,) * 4, url=url)
        faults.ranges.clear()
        assert run_command([url]) == 3
        assert _rows_asked_for(faults) == ["id0", "id1", "id2", "id3"]
        assert len(read_runs(read_batch(url).out)) == 4
    assert "2 done, 2 failed, 0 left" in capsys.readouterr().out


def _rows_asked_for(faults: Faults) -> list[str]:
    """The id of the log for each request for a row, sorted."""
    names = [Path(path.partition("?")[0]) for path, _ in faults.ranges]
    done = [name.parent.name for name in names if name.name == "_DONE.json"]
    return sorted(done + [name.stem for name in names if name.parent.name == "failed"])


def test_an_attempt_that_the_stopped_command_owed_is_made(tmp_path: Path):
    """`status` calls the log left by the same rule."""
    batch = planned(tmp_path / "out", frames=(100,))
    crashed = msgspec.structs.replace(outcome(batch, 0, "crash"), attempt=1, retries=2)
    assert crashed.is_left
    assert waiting_tries({0: crashed}, RunOptions(str(batch.out), retries=0)) == [Try(0, 2)]


def test_the_exit_code_is_that_of_the_batch_if_nobody_reads(batch: Batch):
    """As `hsslam-batch run OUT 2>&1 | tee FILE`, whose `tee` has heard the Ctrl-C, too."""
    readable, writable = os.pipe()
    os.close(readable)
    command = [sys.executable, "-m", "hsslam_batch", "run", str(batch.out)]
    try:
        assert subprocess.call(command, stdout=writable, stderr=writable) == 3
    finally:
        os.close(writable)


def test_the_table_has_what_work_has_mended_since(batch: Batch):
    assert run_command([str(batch.out)]) == 3
    os.utime(batch.out / "runs.parquet", ns=(0, 0))  # a moment before
    commit(batch, outcome(batch, 1), run_folder(batch, 1))  # as `hsslam-batch work` does
    metrics = batch.out.parent / "counts.prom"
    assert run_command([str(batch.out), "--metrics-file", str(metrics)]) == 0
    assert 'hsslam_batch_logs{state="left"} 0.0' in metrics.read_text()  # an alert of before ends
    rows = pq.read_table(batch.out / "runs.parquet").to_pylist()
    assert [row["kind"] for row in rows] == ["done", "done"]


def test_recordings_of_logs_that_are_no_more_planned_go(batch: Batch):
    commit(batch, outcome(batch, 1), run_folder(batch, 1))
    assert run_command([str(batch.out)]) == 0 and batch.rrd_file("id1").exists()
    os.utime(batch.out / "runs.parquet", ns=(0, 0))  # a moment before
    planned(batch.out, frames=(100,))
    assert run_command([str(batch.out)]) == 0
    assert batch.rrd_file("id0").exists() and not batch.rrd_file("id1").exists()


def test_what_waits_and_with_which_attempt(batch: Batch):
    found = {
        0: outcome(batch, 0),
        1: outcome(batch, 1, "bad input"),
        2: None,
        3: outcome(batch, 3, "crash", attempt=2),
        4: outcome(batch, 4, "crash", attempt=3),
    }
    options = RunOptions(out=str(batch.out), retries=2)
    assert waiting_tries(found, options) == [Try(2), Try(3, 3)]
    once_more = RunOptions(out=str(batch.out), retries=2, failed=True)
    assert waiting_tries(found, once_more) == [Try(1), Try(2), Try(3), Try(4)]


def test_logs_that_were_unavailable_come_last_the_one_of_the_latest_attempt_at_the_end(
    batch: Batch,
):
    """Three of them, one after the other, stop the batch: no other log waits for them."""
    found = {
        0: outcome(batch, 0, "unavailable", started_ns=30),
        1: outcome(batch, 1, "unavailable", started_ns=10),
        2: outcome(batch, 2, "unavailable", started_ns=20),
        3: None,
        4: outcome(batch, 4, "crash", attempt=2, started_ns=40),
    }
    waiting = waiting_tries(found, RunOptions(out=str(batch.out), retries=2))
    assert waiting == [Try(3), Try(4, 3), Try(1), Try(2), Try(0)]


def test_two_runs_of_one_batch_do_not_meet(batch: Batch):
    batch.failed_file("id1").unlink()
    with (
        alone(batch.out, batch.place),
        pytest.raises(UserError, match="another hsslam-batch run or plan uses it"),
    ):
        run_command([str(batch.out)])


def test_a_plan_that_is_made_anew_before_the_run_owns_the_batch_is_refused(batch: Batch):
    row = batch.failed_file("id1")
    row.unlink()
    os.mkfifo(row)  # the run waits for it once it has read the plan
    with ThreadPoolExecutor(1) as pool:
        run = pool.submit(run_command, [str(batch.out)])
        with row.open("wb"):
            planned(batch.out, frames=(100,))
        with pytest.raises(OtherPlanError, match=r"out: the plan has just changed: expected"):
            run.result()


@pytest.mark.parametrize(("index", "wanted"), [("1", "id0"), ("2", "id2")])
def test_no_run_is_made_of_another_log_than_planned(
    batch: Batch, capsys: pytest.CaptureFixture[str], index: str, wanted: str
):
    """The batch was planned anew where no lock is seen, and the row holds another log, or none."""
    words = [str(batch.out), "--index", index, "--id", wanted, "--json"]
    with pytest.raises(
        OtherPlanError, match=rf"^--id {wanted}: .* has another log in row {index}: expected"
    ) as raised:
        work_command(words)
    said = msgspec.json.decode(capsys.readouterr().out, type=Line)
    assert said == Refused(str(raised.value))
    assert work_command([str(batch.out), "--index", "0", "--id", "id0"]) == 0  # is done


def test_a_store_that_does_not_answer_is_no_bad_input(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    """Neither of `run`, which may be repeated, nor of `work`: the log has not failed."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(tried, "_TRIES", 1)
    reach("http://127.0.0.1:9", monkeypatch)
    url = f"s3://{BUCKET}/out"
    assert run_command([url]) == 1
    said = capfd.readouterr()
    assert said.err.startswith(f"error: {url}/: ") and said.err.count("\n") == 1
    assert work_command([url, "--index", "0", "--json", "--patience", "0"]) == 3
    line = msgspec.json.decode(capfd.readouterr().out, type=Line)
    assert isinstance(line, Unavailable) and line.reason.startswith(f"{url}/: ")


@pytest.mark.parametrize(
    "words",
    [
        ["--cpus", "0"],
        ["--retries", "-1"],
        ["--parallel", "0"],
        ["--timeout", "0"],
        ["--memory", "nan"],
        ["--fetch-gb", "0"],
        ["--patience", "-1"],
    ],
)
def test_a_wrong_value_is_one_line(batch: Batch, words: list[str]):
    with pytest.raises(UserError, match=f"{words[0]} {words[1]}: expected"):
        run_command([str(batch.out), *words])


def test_other_code_than_planned_is_refused(batch: Batch, capsys: pytest.CaptureFixture[str]):
    batch.failed_file("id1").unlink()
    file = batch.out / "batch.json"
    file.write_text(file.read_text().replace(batch.about.digest, "0123"))
    with pytest.raises(UserError, match=r"was planned with .* \(0123\), this is .*: expected"):
        run_command([str(batch.out)])
    with pytest.raises(UserError, match="was planned with") as raised:
        work_command([str(batch.out), "--index", "1", "--json"])
    said = msgspec.json.decode(capsys.readouterr().out, type=Line)
    assert said == Refused(str(raised.value)) and not batch.failed_file("id1").exists()
