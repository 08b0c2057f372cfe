"""`runs.parquet` has a row for each log that is done or failed, with paths below the folder of the batch."""

import os
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from hsslam_batch.attempt import commit as commit_module
from hsslam_batch.attempt.commit import commit, settle_failed
from hsslam_batch.plan.batch import Batch
from hsslam_batch.plan.log import read_manifest
from hsslam_batch.plan.parquet_rows import write_rows
from hsslam_batch.results.runs_table import is_current, read_runs, write_runs
from hsslam_node.errors import UserError
from tests.batch.outcomes import outcome, planned, run_folder
from tests.until import until


def test_rows_and_paths(tmp_path: Path):
    batch = planned(tmp_path / "out")
    commit(batch, outcome(batch, 0, tracked=99, ate_m=0.01), run_folder(batch, 0))
    settle_failed(batch, outcome(batch, 1, "bad input", reason="no log", exit_code=2))
    write_runs(batch, read_manifest(batch.out))
    done, failed = read_runs(batch.out)
    assert (done["index"], done["name"], done["kind"], done["tracked"]) == (0, "log0", "done", 99)
    assert (done["ate_m"], done["source"]) == (0.01, "mcap:/logs/log0")
    assert done["trajectory"] == "runs/id0/trajectory.txt" and done["rrd"] == "rrd/id0.rrd"
    assert done["map"] is None  # the run has left none
    assert (failed["kind"], failed["reason"], failed["exit_code"]) == ("bad input", "no log", 2)
    assert failed["trajectory"] is None


def test_a_table_without_rows_has_its_columns(tmp_path: Path):
    batch = planned(tmp_path / "out")
    write_runs(batch, read_manifest(batch.out))
    assert read_runs(batch.out) == []
    shutil.rmtree(batch.out)
    with pytest.raises(UserError, match=r"runs.parquet: .*: expected the table of a batch"):
        read_runs(batch.out)


def test_a_table_of_something_else_is_refused_and_one_of_an_earlier_version_is_read(tmp_path: Path):
    table = tmp_path / "runs.parquet"
    write_rows(table, [{"x": 1}], {"x": int})
    with pytest.raises(UserError, match=r"has no column 'id': expected the table of a batch"):
        read_runs(tmp_path)
    row = {"id": "id0", "name": "log0", "configuration": "c", "kind": "done"}
    write_rows(table, [row], dict.fromkeys(row, str))
    (found,) = read_runs(tmp_path)
    assert found["name"] == "log0" and found["ate_m"] is None


def test_a_damaged_table_is_not_current(tmp_path: Path):
    batch = planned(tmp_path / "out")
    table = write_runs(batch, read_manifest(batch.out))
    assert is_current(batch)
    table.write_bytes(table.read_bytes()[:-8])
    assert not is_current(batch)


def test_a_table_without_a_row_that_came_while_it_was_made_is_not_current(tmp_path: Path):
    batch = planned(tmp_path / "out", frames=(100, 200))
    row = batch.failed_file("id1")
    row.parent.mkdir()
    os.mkfifo(row)  # the table waits for it once it has read the row before
    with ThreadPoolExecutor(1) as pool:
        written = pool.submit(write_runs, batch, read_manifest(batch.out))
        with row.open("wb"):
            _wait_for_a_later_time(tmp_path)
            settle_failed(batch, outcome(batch, 0, "bad input"))
            _wait_for_a_later_time(tmp_path)
        written.result()
    assert read_runs(batch.out) == [] and not is_current(batch)


def test_a_table_that_was_made_between_folder_and_row_of_a_result_is_not_current(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    batch = planned(tmp_path / "out", frames=(100,))
    link = commit_module._link_recordings

    def made_meanwhile(batch: Batch, log_id: str) -> None:
        write_runs(batch, read_manifest(batch.out))
        assert is_current(batch)
        _wait_for_a_later_time(tmp_path)
        link(batch, log_id)

    monkeypatch.setattr(commit_module, "_link_recordings", made_meanwhile)
    commit(batch, outcome(batch, 0), run_folder(batch, 0))
    assert read_runs(batch.out) == [] and not is_current(batch)
    write_runs(batch, read_manifest(batch.out))
    assert len(read_runs(batch.out)) == 1 and is_current(batch)


def _wait_for_a_later_time(folder: Path) -> None:
    """Until a change of a file gets a later time than one before; the clock of files goes in steps."""

    def changed_ns() -> int:
        (folder / "probe").touch()
        return (folder / "probe").stat().st_mtime_ns

    before_ns = changed_ns()
    until(lambda: changed_ns() > before_ns)
