"""`hsslam-batch run` on a Ray cluster of this machine: the same results as by hand, whatever is killed.

It takes minutes, so it has the mark `long`: `pytest -m long tests/batch`.
"""

import json
import math
import os
import shutil
import signal
import time
from pathlib import Path

import pytest

from hsslam_batch.attempt.commit import all_settled
from hsslam_batch.attempt.store_results import StoredOutcome
from hsslam_batch.plan.batch import Batch
from hsslam_batch.plan.log import read_manifest
from hsslam_batch.results.runs_table import read_runs
from hsslam_bench.batch.ray_nodes import add_node
from hsslam_bench.batch.small_log import write_small_log
from hsslam_services.run.stop_signals import ONE_REQUEST_S
from tests.batch.cluster.runs_of_batch import (
    LONG_S,
    arenas,
    by_hand,
    end,
    nothing_left,
    of_batch,
    planned,
    services,
    start,
    start_unread,
    trajectories,
    wait,
)
from tests.batch.object_store import BUCKET, Faults, faulty, object_store, reach
from tests.caught_signals import catches

pytestmark = [pytest.mark.e2e, pytest.mark.long, pytest.mark.timeout(3600)]


@pytest.fixture
def batch(tmp_path: Path) -> Batch:
    """Three good logs and a damaged one."""
    for k in range(3):
        write_small_log(tmp_path / "logs" / f"good{k}", start=20 * k, count=4)
    log = write_small_log(tmp_path / "logs" / "damaged", count=1)
    log.write_bytes(b"no log" + log.read_bytes())
    return planned(tmp_path / "logs", tmp_path / "out")


def test_a_cluster_makes_what_one_makes_by_hand(
    cluster, batch: Batch, tmp_path: Path, pools: set[Path]
):
    for _ in range(3):
        add_node(cluster)
    said = end(run := start(batch, "--address", cluster.address))
    assert run.returncode == 3, said
    assert "damaged: bad input: " in said and "3 done, 1 failed, 0 left" in said
    assert trajectories(batch) == by_hand(batch, tmp_path / "hand")
    rows = read_runs(batch.out)
    assert sorted((row["name"], row["kind"]) for row in rows) == [
        ("damaged", "bad input"),
        *((f"good{k}", "done") for k in range(3)),
    ]
    assert all(row["attempt"] == 1 for row in rows)
    assert nothing_left(batch, pools) and not batch.work.exists()
    events = [json.loads(line) for line in (batch.out / "progress.jsonl").read_text().splitlines()]
    assert [e["event"] for e in events].count("done") == 3 and events[-1]["left"] == 0

    start_s = time.monotonic()
    said = end(again := start(batch))
    assert again.returncode == 3 and "3 done, 1 failed, 0 left" in said
    assert time.monotonic() - start_s < 60  # 5 s on a machine of its own
    assert read_runs(batch.out) == rows


def test_a_killed_run_is_tried_again(batch: Batch, pools: set[Path]):
    run = start(batch, "--parallel", "1")
    killed = set()

    def kill_first_run() -> bool:
        for process in of_batch(batch):
            words = process.info["cmdline"]
            if "hsslam_services.commands.serve" in words and process.pid not in killed:
                killed.add(process.pid)
                process.kill()
                return True
        return run.poll() is not None

    wait(kill_first_run)
    said = end(run)
    assert run.returncode == 3 and "3 done, 1 failed" in said
    assert sorted(row["attempt"] for row in read_runs(batch.out)) == [1, 1, 1, 2]
    assert nothing_left(batch, pools)


def test_ctrl_c_and_a_killed_driver_leave_what_the_next_run_does(batch: Batch, pools: set[Path]):
    run = start(batch, "--parallel", "1")
    wait(lambda: arenas(batch) or run.poll() is not None)
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGHUP):  # the terminal is closed meanwhile
        run.send_signal(number)
    said = end(run)
    assert run.returncode == 1 and "no more logs start" in said and "left" in said
    rows = read_runs(batch.out)
    assert sum(row["kind"] == "done" for row in rows) == 1
    assert nothing_left(batch, pools)

    second = start(batch, "--parallel", "1")
    wait(lambda: arenas(batch) or second.poll() is not None)
    os.kill(second.pid, signal.SIGKILL)
    end(second)
    wait(lambda: nothing_left(batch, pools))

    said = end(third := start(batch))
    assert third.returncode == 3 and "3 done, 1 failed, 0 left" in said
    assert next(row["name"] for row in rows if row["kind"] == "done") in trajectories(batch)
    assert len(read_runs(batch.out)) == 4 and nothing_left(batch, pools)


def test_a_second_ctrl_c_ends_running_logs_which_count_as_not_tried(batch: Batch, pools: set[Path]):
    run = start(batch, "--parallel", "1")
    wait(lambda: services(batch) or run.poll() is not None)
    (service,) = services(batch)
    service.suspend()  # the log cannot finish meanwhile
    run.send_signal(signal.SIGINT)
    assert run.stdout and any("no more logs start" in line for line in run.stdout)
    heard_s = time.monotonic()
    wait(lambda: time.monotonic() - heard_s > ONE_REQUEST_S)
    run.send_signal(signal.SIGINT)
    said = run.stdout.read()
    assert run.wait(LONG_S) == 1 and "Traceback" not in said, said
    service.resume()
    wait(lambda: nothing_left(batch, pools))
    rows = all_settled(batch, read_manifest(batch.out)).values()
    assert [(row.name, row.kind) for row in rows] == [("damaged", "bad input")]  # it was first

    said = end(second := start(batch))
    assert second.returncode == 3 and "3 done, 1 failed, 0 left" in said, said
    assert all(row["attempt"] == 1 for row in read_runs(batch.out))


def test_running_logs_finish_if_nobody_reads_the_answer_to_ctrl_c(batch: Batch, pools: set[Path]):
    run = start_unread(batch, "--parallel", "1")
    wait(lambda: arenas(batch) or run.poll() is not None)
    run.send_signal(signal.SIGINT)
    assert run.wait(LONG_S) == 1
    kinds = {row["name"]: row["kind"] for row in read_runs(batch.out)}
    assert kinds == {"damaged": "bad input", "good0": "done"}
    assert nothing_left(batch, pools)


def test_a_stop_while_ray_starts_begins_no_log(batch: Batch, pools: set[Path]):
    run = start(batch)
    wait(lambda: catches(run.pid, signal.SIGTERM) or run.poll() is not None)
    run.send_signal(signal.SIGTERM)
    said = end(run)
    assert run.returncode == 1 and "Traceback" not in said, said
    assert nothing_left(batch, pools) and not (batch.out / "runs").exists()


def test_a_store_that_is_away_for_a_while_costs_no_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pools: set[Path]
):
    """It goes away while the first result is uploaded, for longer than an attempt waits."""
    faults = Faults(1000, of_all=True)
    with object_store() as (server, _), faulty(server, faults) as address:
        for k in range(3):
            write_small_log(tmp_path / "logs" / f"good{k}", start=20 * k, count=4)
        reach(address, monkeypatch)
        url = f"s3://{BUCKET}/out"
        batch = planned(tmp_path / "logs", url)
        try:
            run = start(batch, "--parallel", "2", "--patience", "15")
            wait(
                lambda: any("/runs/" in path and "trajectory" in path for path, _ in faults.ranges)
            )
            faults.away = math.inf
            back_s = time.monotonic() + 30
            wait(lambda: time.monotonic() > back_s)
            faults.away = 0
            said = end(run)
            assert run.returncode == 0 and "3 done, 0 failed, 0 left" in said, said
            events = (batch.out / "progress.jsonl").read_text().splitlines()
            again = [event for event in map(json.loads, events) if event["event"] == "again"]
            assert again and all(event["kind"] == "unavailable" for event in again)
            assert nothing_left(batch, pools)
        finally:
            shutil.rmtree(batch.out)


def test_logs_and_results_in_a_store_that_fails_now_and_then(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pools: set[Path]
):
    with object_store() as (server, client), faulty(server, Faults(10, of_all=True)) as address:
        for k in range(2):
            log = write_small_log(tmp_path / "logs" / f"good{k}", start=20 * k, count=4)
            client.upload_file(str(log), BUCKET, f"logs/good{k}/run.mcap")
        hand = by_hand(planned(tmp_path / "logs", tmp_path / "out"), tmp_path / "hand")
        reach(address, monkeypatch)
        url = f"s3://{BUCKET}/out"
        batch = planned(f"s3://{BUCKET}/logs", url)
        try:
            said = end(run := start(batch))
            assert run.returncode == 0 and "2 done, 0 failed, 0 left" in said, said
            made = {}
            rows = all_settled(batch, read_manifest(batch.out))
            for log_id, row in rows.items():
                assert isinstance(row, StoredOutcome) and row.frames == 4
                key = f"out/runs/{log_id}/{row.folder}/trajectory.txt"
                made[row.name] = client.get_object(Bucket=BUCKET, Key=key)["Body"].read()
            assert made == hand
            client.download_file(BUCKET, "out/runs.parquet", str(tmp_path / "runs.parquet"))
            table = read_runs(tmp_path)
            assert sorted((row["name"], row["kind"]) for row in table) == [
                *((f"good{k}", "done") for k in range(2))
            ]
            events = client.get_object(Bucket=BUCKET, Key="out/progress.jsonl")["Body"].read()
            assert json.loads(events.splitlines()[-1])["left"] == 0
            assert nothing_left(batch, pools) and not batch.work.exists()

            said = end(again := start(batch))
            assert again.returncode == 0 and "2 done, 0 failed, 0 left" in said
            assert all_settled(batch, read_manifest(batch.out)) == rows
        finally:
            shutil.rmtree(batch.out)
