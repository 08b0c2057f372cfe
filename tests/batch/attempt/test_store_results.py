"""Results in an object store count from one step on, once and whole, in spite of its faults."""

import math
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from hsslam_batch.attempt.commit import all_settled, commit, settle_failed, settle_files, settled
from hsslam_batch.attempt.store_results import StoredOutcome
from hsslam_batch.cluster.work_folder import clear_work
from hsslam_batch.plan import tried
from hsslam_batch.plan.batch import Batch
from hsslam_batch.plan.log import read_manifest
from hsslam_batch.plan.read_batch import read_batch
from hsslam_batch.results.report import report_command
from hsslam_batch.results.runs_table import known_rows, read_runs
from hsslam_batch.results.status import status_command
from hsslam_node.errors import UserError
from tests.batch.object_store import BUCKET, Faults, faulty, object_store, reach
from tests.batch.outcomes import outcome, planned, run_folder
from tests.until import until


@pytest.fixture(scope="module")
def server() -> Iterator[tuple[str, Any]]:
    """An object store."""
    with object_store() as found:
        yield found


@pytest.fixture
def plan(server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Batch]:
    """Plans a batch in the store, in a folder of this test."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(tried, "_FIRST_WAIT_S", 0.01)
    reach(server[0], monkeypatch)
    url = f"s3://{BUCKET}/{tmp_path.name}"
    return lambda **options: planned(tmp_path / "here", url=url, **options)


def _objects(server: tuple[str, Any], batch: Batch, below: str = "") -> dict[str, bytes]:
    """All that the store has of a batch, by name."""
    client, prefix = server[1], batch.url.removeprefix(f"s3://{BUCKET}/")
    listed = client.list_objects_v2(Bucket=BUCKET, Prefix=f"{prefix}/{below}").get("Contents", [])
    return {
        one["Key"].removeprefix(f"{prefix}/"): (
            client.get_object(Bucket=BUCKET, Key=one["Key"])["Body"].read()
        )
        for one in listed
    }


def test_rows_and_files_are_those_of_a_folder(plan, server, tmp_path: Path, monkeypatch, capsys):
    local = planned(tmp_path / "local")
    faults = Faults(every=5, of_all=True)
    with faulty(server[0], faults) as address:
        reach(address, monkeypatch)
        remote = plan()
        for batch in (local, remote):
            for k in range(2):
                made = outcome(batch, k, tracked=99, frames=100, core_s=2.0)
                commit(batch, made, run_folder(batch, k, f"poses {k}" * 5000))
            settle_failed(batch, outcome(batch, 2, "bad input", reason="no log"))
        assert status_command([remote.url]) == status_command([str(local.out)]) == 3
        assert report_command([remote.url, "--against", str(local.out)]) == 0
    assert faults.refused > 2 and faults.broken > 2
    said = capsys.readouterr().out.splitlines()
    assert said[0] == said[1] == "3 logs: 2 done, 1 failed, 0 left; 200 of 300 frames"
    reach(server[0], monkeypatch)
    there = _objects(server, remote)
    runs = read_runs(read_batch(remote.url).out)
    (tmp_path / "runs.parquet").write_bytes(there["runs.parquet"])
    assert read_runs(tmp_path) == runs
    emptied = read_batch(remote.url)
    assert emptied.store
    emptied.store.remove(name for name in there if name.startswith("runs/"))
    assert known_rows(emptied, read_manifest(emptied.out)) == runs
    report_command([str(local.out)])
    for mine, other in zip(runs, read_runs(local.out), strict=True):
        for name in ("trajectory", "mesh", "rrd", "map"):
            mine_at, other_at = mine.pop(name), other.pop(name)
            assert (mine_at is None) == (other_at is None)
            if mine_at is not None:
                assert there[mine_at] == (local.out / other_at).read_bytes()
        assert mine == other


def test_the_first_of_attempts_at_once_stays_whole(plan, server):
    batch = plan()
    folders = []
    for k in range(4):
        folder = run_folder(batch, 0, f"attempt {k}")
        folders.append(folder.rename(batch.work / f"run{k}"))
        folder.parent.rmdir()

    def attempt(k: int) -> None:
        own = replace(batch)  # a connection of its own
        commit(own, outcome(batch, 0, attempt=k + 1), folders[k])
        settle_failed(own, outcome(batch, 0, "lost", attempt=k + 1))

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(attempt, range(4)))
    row = settled(batch, "id0")
    assert isinstance(row, StoredOutcome) and row.is_done
    objects = _objects(server, batch, "runs/")
    files = {f"runs/id0/{row.folder}/{name}" for name in row.files}
    assert objects.keys() == {"runs/id0/_DONE.json", *files} and len(row.files) == 5
    assert {objects[name] for name in files} == {f"attempt {row.attempt - 1}".encode()}
    assert not _objects(server, batch, "failed/")


def test_what_was_uploaded_in_part_does_not_count(plan, server, monkeypatch):
    batch = plan()
    run_dir = run_folder(batch, 0)
    assert batch.store
    batch.store.upload(run_dir, "runs/id0/1.0123abcd")  # and then its machine is lost
    left = _objects(server, batch, "runs/")
    assert len(left) == 5 and settled(batch, "id0") is None
    monkeypatch.setattr(tried, "_TRIES", 1)
    with faulty(server[0], Faults(every=1, of_all=True)) as address:
        reach(address, monkeypatch)
        with pytest.raises(OSError, match=r"^s3://"):
            commit(replace(batch), outcome(batch, 0), run_dir)
        with pytest.raises(UserError, match=r"^s3://.*: expected a folder that can be written"):
            all_settled(replace(batch), read_manifest(batch.out))
    reach(server[0], monkeypatch)
    batch = replace(batch)
    commit(batch, outcome(batch, 0, attempt=2), run_dir)
    row = settled(batch, "id0")
    assert row and row.attempt == 2
    settle_files(batch, read_manifest(batch.out))  # as `run` at its end
    assert not left.keys() & _objects(server, batch, "runs/").keys()
    assert len(_objects(server, batch, "runs/")) == 6


def test_an_attempt_leaves_the_files_of_another_that_may_become_the_result(plan, server):
    """As in a store that does not refuse to create a file that exists: the last attempt is the result."""
    batch = plan()
    commit(batch, outcome(batch, 0), run_folder(batch, 0, "first"))
    commit(batch, outcome(batch, 1), run_folder(batch, 1, "first"))
    assert batch.store
    batch.store.remove(["runs/id0/_DONE.json"])  # not yet written, as the next attempt sees it
    first = _objects(server, batch, "runs/")
    commit(batch, outcome(batch, 0, attempt=2), _second_run_folder(batch))
    assert first.items() <= _objects(server, batch, "runs/").items()
    row = settled(batch, "id0")
    assert isinstance(row, StoredOutcome) and row.attempt == 2
    batch.store.upload(run_folder(batch, 2), "runs/id2/1.0123abcd")  # it may still become a result
    batch.store.upload(run_folder(batch, 3), "runs/id2/2.0123abcd")
    settle_files(batch, read_manifest(batch.out))
    there = _objects(server, batch, "runs/")
    assert len(there) == 6 + 6 + 10
    assert all(there[f"runs/id0/{row.folder}/{name}"] == b"second" for name in row.files)


def test_an_attempt_waits_for_a_store_that_is_away(plan, server, monkeypatch):
    """A run of hours is not lost to a store that fails for longer than a request of a user may take."""
    planned = plan()
    monkeypatch.setattr(tried, "_LONGEST_WAIT_S", 0.05)
    faults = Faults(1000, of_all=True, away=50)
    with faulty(server[0], faults) as address:
        reach(address, monkeypatch)
        with pytest.raises(OSError, match=r"^s3://"):
            settled(replace(planned), "id0")
        assert faults.refused < 50
        batch = replace(planned, patience_s=600.0)
        commit(batch, outcome(batch, 0), run_folder(batch, 0))
        assert faults.away == 0
        row = settled(batch, "id0")
    assert row and row.is_done and len(_objects(server, batch, "runs/")) == 6


def test_a_run_folder_that_is_removed_meanwhile_becomes_no_result(plan, server, monkeypatch):
    """As of an attempt of an earlier `run` that still waits for the store when the next one begins."""
    planned = plan()
    monkeypatch.setattr(tried, "_LONGEST_WAIT_S", 0.05)
    faults = Faults(1000, of_all=True, away=math.inf)
    with faulty(server[0], faults) as address, ThreadPoolExecutor(1) as pool:
        reach(address, monkeypatch)
        batch = replace(planned, patience_s=600.0)
        late = pool.submit(commit, batch, outcome(batch, 0), run_folder(batch, 0))
        until(lambda: faults.refused)
        clear_work(batch)
        faults.away = 0
        with pytest.raises(OSError, match=r"run: no summary\.json: expected a run folder"):
            late.result()
    assert settled(batch, "id0") is None and not _objects(server, batch, "runs/")


def test_a_folder_without_files_is_not_uploaded(plan, server, tmp_path: Path):
    batch = plan()
    assert batch.store
    (tmp_path / "empty").mkdir()
    for name in ("empty", "missing"):
        with pytest.raises(OSError, match=rf"{name}: no files: expected a folder to upload"):
            batch.store.upload(tmp_path / name, "runs/id0/1.0123abcd")


def test_results_of_another_configuration_are_replaced(plan, server):
    batch = plan()
    commit(batch, outcome(batch, 0), run_folder(batch, 0))
    settle_failed(batch, outcome(batch, 1, "crash"))
    other = plan(seed=1)
    assert all_settled(other, read_manifest(other.out)) == {}
    commit(other, outcome(other, 0, attempt=3), run_folder(other, 3, "other"))
    row = settled(other, "id0")
    assert row and row.attempt == 3 and settled(batch, "id0") is None
    settle_files(other, read_manifest(other.out))
    files = {name for name in _objects(server, batch, "runs/id0/") if not name.endswith(".json")}
    assert len(files) == 4 and all("/3." in name for name in files)
    settle_failed(other, outcome(other, 0, "lost"))
    assert settled(other, "id0") == row


def test_results_of_another_configuration_stay_until_there_are_new_ones(plan, server, monkeypatch):
    batch = plan()
    commit(batch, outcome(batch, 0), run_folder(batch, 0))
    first = settled(batch, "id0")
    files = _objects(server, batch, "runs/")
    other = plan(seed=1)
    settle_failed(other, outcome(other, 0, "timeout"))
    row = settled(other, "id0")
    assert row and row.kind == "timeout"
    run_dir = run_folder(other, 3, "other")
    monkeypatch.setattr(tried, "_TRIES", 1)
    faults = Faults(every=3, of_all=True)  # rows are read, uploads fail
    with faulty(server[0], faults) as address, pytest.raises(OSError, match=r"^s3://"):
        reach(address, monkeypatch)
        commit(replace(other), outcome(other, 0), run_dir)
    assert faults.refused + faults.broken > 0
    reach(server[0], monkeypatch)
    assert settled(replace(batch), "id0") == first
    assert files.items() <= _objects(server, batch, "runs/").items()


def test_a_url_without_a_batch_is_one_line(plan, monkeypatch):
    with pytest.raises(UserError, match=r"^s3://fleet/none/manifest.parquet: no such file: exp"):
        read_batch(f"s3://{BUCKET}/none")
    monkeypatch.setattr(tried, "_TRIES", 1)
    reach("http://127.0.0.1:9", monkeypatch)
    with pytest.raises(
        UserError, match=r"^s3://fleet/none/: .*: expected a store that can be read"
    ):
        read_batch(f"s3://{BUCKET}/none")


def test_a_file_url_is_a_folder(tmp_path: Path):
    batch = planned(tmp_path / "with a space")
    assert read_batch(f"file://{tmp_path}/with%20a%20space") == batch


def _second_run_folder(batch: Batch) -> Path:
    """The run folder of a second attempt at log 0."""
    (batch.work / "id0.1").rename(batch.work / "away")
    return run_folder(batch, 0, "second")
