"""`hsslam-batch run` on a Ray cluster of this machine: the same results as by hand, whatever is killed.

It takes minutes, so it has the mark `long`: `pytest -m long tests/batch`.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

from hsslam_batch.attempt.commit import all_settled
from hsslam_batch.attempt.store_results import StoredOutcome
from hsslam_batch.plan.batch import Batch, read_batch
from hsslam_batch.plan.command import plan_command
from hsslam_batch.plan.log import read_manifest
from hsslam_batch.results.runs_table import read_runs
from hsslam_bench.batch.small_log import write_small_log
from tests.batch.cluster.ray_nodes import add_node
from tests.batch.object_store import BUCKET, Faults, faulty, object_store, reach
from tests.batch.quick_options import QUICK

pytestmark = [pytest.mark.e2e, pytest.mark.long, pytest.mark.timeout(3600)]
_LONG_S = 3000
_MEMORY = ("--memory", "4")


@pytest.fixture
def batch(tmp_path: Path) -> Batch:
    """Three good logs and a damaged one."""
    for k in range(3):
        write_small_log(tmp_path / "logs" / f"good{k}", start=20 * k, count=4)
    log = write_small_log(tmp_path / "logs" / "damaged", count=1)
    log.write_bytes(b"no log" + log.read_bytes())
    plan_command([str(tmp_path / "logs"), "--out", str(tmp_path / "out"), *QUICK])
    return read_batch(str(tmp_path / "out"))


def _start(batch: Batch, *options: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "hsslam_batch", "run", batch.place, *_MEMORY, *options]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    )


def _end(run: subprocess.Popen[str]) -> str:
    """What it printed."""
    said, _ = run.communicate(timeout=_LONG_S)
    return said


def _wait(condition: Callable[[], object]) -> None:
    deadline = time.monotonic() + _LONG_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def _of_batch(batch: Batch) -> list[psutil.Process]:
    """Processes that live and name a run of the batch."""
    return [
        process
        for process in psutil.process_iter(["cmdline", "status"])
        if str(batch.work) in " ".join(process.info["cmdline"] or [])
        and process.info["status"] != psutil.STATUS_ZOMBIE
    ]


def _arenas(batch: Batch) -> list[Path]:
    """Shared memory of runs of the batch."""
    found = []
    for owner in Path("/dev/shm").glob("hsslam-*/owner.json"):
        if json.loads(owner.read_text())["run_dir"].startswith(str(batch.work)):
            found.append(owner.parent)
    return found


def _nothing_left(batch: Batch) -> bool:
    return not _of_batch(batch) and not _arenas(batch)


def _trajectories(batch: Batch) -> dict[str, bytes]:
    return {
        log.name: (batch.run_dir(log.id) / "trajectory.txt").read_bytes()
        for log in read_manifest(batch.out)
        if batch.done_file(log.id).exists()
    }


def _by_hand(batch: Batch, folder: Path) -> dict[str, bytes]:
    """The trajectories that a user makes, one log after the other."""
    found = {}
    for log in read_manifest(batch.out):
        if log.name.startswith("good"):
            out = folder / log.name
            serve = [sys.executable, "-m", "hsslam_services.commands.serve", "--source", log.source]
            options = ["--out", str(out), "--pace", "lockstep", "--viewer", "none", *QUICK]
            subprocess.run([*serve, *options], check=True, capture_output=True, timeout=_LONG_S)
            found[log.name] = (out / "trajectory.txt").read_bytes()
    return found


def test_a_cluster_makes_what_one_makes_by_hand(cluster, batch: Batch, tmp_path: Path):
    for _ in range(3):
        add_node(cluster)
    said = _end(run := _start(batch, "--address", cluster.address))
    assert run.returncode == 3, said
    assert "damaged: bad input: " in said and "3 done, 1 failed, 0 left" in said
    assert _trajectories(batch) == _by_hand(batch, tmp_path / "hand")
    rows = read_runs(batch.out)
    assert sorted((row["name"], row["kind"]) for row in rows) == [
        ("damaged", "bad input"),
        *((f"good{k}", "done") for k in range(3)),
    ]
    assert all(row["attempt"] == 1 for row in rows)
    assert _nothing_left(batch) and not batch.work.exists()
    events = [json.loads(line) for line in (batch.out / "progress.jsonl").read_text().splitlines()]
    assert [e["event"] for e in events].count("done") == 3 and events[-1]["left"] == 0

    start_s = time.monotonic()
    said = _end(again := _start(batch))
    assert again.returncode == 3 and "3 done, 1 failed, 0 left" in said
    assert time.monotonic() - start_s < 60  # 5 s on a machine of its own
    assert read_runs(batch.out) == rows


def test_a_killed_run_is_tried_again(batch: Batch):
    run = _start(batch, "--parallel", "1")
    killed = set()

    def kill_first_run() -> bool:
        for process in _of_batch(batch):
            words = process.info["cmdline"]
            if "hsslam_services.commands.serve" in words and process.pid not in killed:
                killed.add(process.pid)
                process.kill()
                return True
        return run.poll() is not None

    _wait(kill_first_run)
    said = _end(run)
    assert run.returncode == 3 and "3 done, 1 failed" in said
    assert sorted(row["attempt"] for row in read_runs(batch.out)) == [1, 1, 1, 2]
    assert _nothing_left(batch)


def test_ctrl_c_and_a_killed_driver_leave_what_the_next_run_does(batch: Batch):
    run = _start(batch, "--parallel", "1")
    _wait(lambda: _arenas(batch) or run.poll() is not None)
    run.send_signal(signal.SIGINT)
    said = _end(run)
    assert run.returncode == 1 and "no more logs begin" in said and "left" in said
    rows = read_runs(batch.out)
    assert sum(row["kind"] == "done" for row in rows) == 1
    assert _nothing_left(batch)

    second = _start(batch, "--parallel", "1")
    _wait(lambda: _arenas(batch) or second.poll() is not None)
    os.kill(second.pid, signal.SIGKILL)
    _end(second)
    _wait(lambda: _nothing_left(batch))

    said = _end(third := _start(batch))
    assert third.returncode == 3 and "3 done, 1 failed, 0 left" in said
    assert next(row["name"] for row in rows if row["kind"] == "done") in _trajectories(batch)
    assert len(read_runs(batch.out)) == 4 and _nothing_left(batch)


def test_logs_and_results_in_a_store_that_fails_now_and_then(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    with object_store() as (server, client), faulty(server, Faults(10, of_all=True)) as address:
        for k in range(2):
            log = write_small_log(tmp_path / "logs" / f"good{k}", start=20 * k, count=4)
            client.upload_file(str(log), BUCKET, f"logs/good{k}/run.mcap")
        here = str(tmp_path / "out")
        plan_command([str(tmp_path / "logs"), "--out", here, *QUICK])
        by_hand = _by_hand(read_batch(here), tmp_path / "hand")
        reach(address, monkeypatch)
        url = f"s3://{BUCKET}/out"
        plan_command([f"s3://{BUCKET}/logs", "--out", url, *QUICK])
        batch = read_batch(url)
        try:
            said = _end(run := _start(batch))
            assert run.returncode == 0 and "2 done, 0 failed, 0 left" in said, said
            made = {}
            rows = all_settled(batch, read_manifest(batch.out))
            for log_id, row in rows.items():
                assert isinstance(row, StoredOutcome) and row.frames == 4
                key = f"out/runs/{log_id}/{row.folder}/trajectory.txt"
                made[row.name] = client.get_object(Bucket=BUCKET, Key=key)["Body"].read()
            assert made == by_hand
            client.download_file(BUCKET, "out/runs.parquet", str(tmp_path / "runs.parquet"))
            table = read_runs(tmp_path)
            assert sorted((row["name"], row["kind"]) for row in table) == [
                *((f"good{k}", "done") for k in range(2))
            ]
            events = client.get_object(Bucket=BUCKET, Key="out/progress.jsonl")["Body"].read()
            assert json.loads(events.splitlines()[-1])["left"] == 0
            assert _nothing_left(batch) and not batch.work.exists()

            said = _end(again := _start(batch))
            assert again.returncode == 0 and "2 done, 0 failed, 0 left" in said
            assert all_settled(batch, read_manifest(batch.out)) == rows
        finally:
            shutil.rmtree(batch.out)
