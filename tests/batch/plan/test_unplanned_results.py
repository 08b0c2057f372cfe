"""`hsslam-batch plan` reports results of logs that are no longer in the plan, and keeps them."""

import os
from pathlib import Path

import pytest

from hsslam_batch.attempt.commit import commit
from hsslam_batch.attempt.outcome import Outcome
from hsslam_batch.plan.batch import Batch
from hsslam_batch.plan.command import plan_command
from hsslam_batch.plan.log import read_manifest
from hsslam_batch.plan.read_batch import read_batch
from hsslam_bench.batch.small_log import write_small_log
from tests.batch.object_store import BUCKET, Faults, faulty, object_store, reach

_RUN_BYTES = 30_000_000
_TOLD = "runs/: 1 folder is of no log of this plan and not removed, 0.03 GB\n"


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    """Two logs of one frame."""
    for k in range(2):
        write_small_log(tmp_path / "logs" / f"log{k}", start=10 * k, count=1)
    return tmp_path / "logs"


def _planned_and_run(logs: Path, out: str) -> Batch:
    """A batch whose logs are done; each run folder has a file of 30 MB."""
    plan_command([str(logs), "--out", out])
    batch = read_batch(out)
    for log in read_manifest(batch.out):
        run_dir = batch.work / log.id / "run"
        run_dir.mkdir(parents=True)
        with (run_dir / "mesh.ply").open("wb") as stream:
            stream.truncate(_RUN_BYTES)
        (run_dir / "summary.json").touch()
        commit(batch, Outcome(log.id, log.name, batch.about.configuration, 1, "done"), run_dir)
    return batch


def _change(logs: Path) -> None:
    """Copy a log anew."""
    os.utime(logs / "log0" / "run.mcap", ns=(1, 1))


def test_results_of_a_log_that_has_changed_are_told_and_kept(logs: Path, tmp_path: Path, capsys):
    batch = _planned_and_run(logs, str(tmp_path / "out"))
    plan_command([str(logs), "--out", batch.place])
    assert "runs/: " not in capsys.readouterr().out
    before = read_manifest(batch.out)
    _change(logs)
    plan_command([str(logs), "--out", batch.place])
    assert _TOLD in capsys.readouterr().out
    assert all(batch.done_file(log.id).exists() for log in before)


def test_a_plan_of_a_store_lists_the_results_once(
    logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    asked = Faults(every=1_000_000, of_all=True)  # it only counts
    with object_store() as (server, _), faulty(server, asked) as address:
        reach(address, monkeypatch)
        batch = _planned_and_run(logs, f"s3://{BUCKET}/out")
        for line, listings in (("", 1), (_TOLD, 2)):
            asked.ranges.clear()
            capsys.readouterr()
            plan_command([str(logs), "--out", batch.place])
            said = capsys.readouterr().out
            assert line in said and ("runs/: " in said) == bool(line)
            assert sum("list-type" in path for path, _ in asked.ranges) == listings
            _change(logs)
