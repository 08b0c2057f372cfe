"""Logs and results in Google's store, for which an emulator answers; skipped without its packages.

pip install gcsfs gcp-storage-emulator
"""

import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hsslam_batch.attempt.commit import all_settled, commit, settle_failed
from hsslam_batch.attempt.fetch import fetch_log, fetched_place
from hsslam_batch.attempt.store_results import StoredOutcome
from hsslam_batch.plan.command import plan_command
from hsslam_batch.plan.log import read_manifest
from hsslam_batch.plan.read_batch import read_batch
from hsslam_batch.results.report import report_command
from hsslam_batch.results.runs_table import read_runs
from hsslam_batch.results.status import status_command
from hsslam_node.errors import UserError
from tests.batch.outcomes import outcome, run_folder

gcsfs = pytest.importorskip("gcsfs")
emulator = pytest.importorskip("gcp_storage_emulator.server")
_BUCKET = "fleet"
_OBJECTS = {
    "logs/": b"",  # as the console makes a folder
    "logs/damaged.mcap": b"no log",
    "logs/walk/run.mcap": b"first part" * 2_000_000,
    "logs/walk/run.1.mcap": b"second part",
}


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """The emulator with logs, as gcsfs sees it."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    monkeypatch.setenv("STORAGE_EMULATOR_HOST", f"http://127.0.0.1:{port}")
    monkeypatch.setenv("GCSFS_EXPERIMENTAL_ZB_HNS_SUPPORT", "false")  # it asks Google itself
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    gcsfs.GCSFileSystem.clear_instance_cache()
    server = emulator.create_server("127.0.0.1", port, in_memory=True, default_bucket=_BUCKET)
    server.start()
    try:
        files = gcsfs.GCSFileSystem()
        for name, content in _OBJECTS.items():
            files.pipe_file(f"{_BUCKET}/{name}", content)
        yield files
    finally:
        server.stop()
        gcsfs.GCSFileSystem.clear_instance_cache()


def test_a_batch_is_planned_fetched_and_kept(store: Any, tmp_path: Path, capsys):
    url = f"gs://{_BUCKET}/out"
    plan_command([f"gs://{_BUCKET}/logs", "--out", url])
    batch = read_batch(url)
    damaged, walk = read_manifest(batch.out)
    assert (damaged.name, walk.name, walk.nbytes) == ("damaged.mcap", "walk", 20_000_011)

    fetch_log(walk, tmp_path / "fetched", most_gb=1.0)
    place = fetched_place(tmp_path / "fetched", walk)
    fetched = {f"logs/walk/{path.name}": path.read_bytes() for path in place.iterdir()}
    assert fetched == {k: v for k, v in _OBJECTS.items() if k.startswith("logs/walk/")}

    settle_failed(batch, outcome(batch, 0, "bad input", id=damaged.id, name=damaged.name))
    for attempt in (1, 2):  # the second comes late
        folder = run_folder(batch, attempt, f"poses {attempt}" * 5000)
        commit(batch, outcome(batch, 1, id=walk.id, name=walk.name, attempt=attempt), folder)
    row = all_settled(batch, [damaged, walk])[walk.id]
    assert isinstance(row, StoredOutcome) and row.attempt == 1
    assert batch.store and {*batch.store.sizes(f"runs/{walk.id}")} == {
        "_DONE.json",
        *(f"{row.folder}/{name}" for name in row.files),
    }
    poses = store.cat_file(f"{_BUCKET}/out/runs/{walk.id}/{row.folder}/trajectory.txt")
    assert poses == b"poses 1" * 5000
    assert status_command([url]) == 3 and report_command([url]) == 0
    assert "2 logs: 1 done, 1 failed, 0 left" in capsys.readouterr().out
    (tmp_path / "runs.parquet").write_bytes(store.cat_file(f"{_BUCKET}/out/runs.parquet"))
    assert [row["kind"] for row in read_runs(tmp_path)] == ["bad input", "done"]

    store.pipe_file(f"{_BUCKET}/logs/walk/run.1.mcap", b"other parts")
    with pytest.raises(UserError, match=r"walk: has changed since the plan"):
        fetch_log(walk, tmp_path / "changed", most_gb=1.0)
