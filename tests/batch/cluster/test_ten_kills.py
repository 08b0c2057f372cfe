"""A batch in which ten of a kind are killed, one after the other, loses nothing and leaves nothing.

It takes minutes, so it has the mark `long`: `pytest -m long tests/batch`.
"""

import contextlib
import os
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest

from hsslam_batch.plan.batch import Batch
from hsslam_batch.plan.log import read_manifest
from hsslam_batch.results.runs_table import read_runs
from hsslam_bench.batch.ray_nodes import add_node
from hsslam_bench.batch.small_log import write_small_log
from tests.batch.cluster.runs_of_batch import (
    by_hand,
    end,
    nothing_left,
    planned,
    services,
    start,
    trajectories,
    wait,
    worker_of,
)

pytestmark = [pytest.mark.e2e, pytest.mark.long, pytest.mark.timeout(3600)]
_LOGS, _NODES, _KILLS = 6, 3, 10
_RETRIES = ("--retries", str(_KILLS))


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Short logs."""
    folder = tmp_path_factory.mktemp("kills")
    for k in range(_LOGS):
        write_small_log(folder / "logs" / f"good{k}", start=20 * k, count=4)
    return folder / "logs"


@pytest.fixture(scope="module")
def expected(logs: Path) -> dict[str, bytes]:
    """The trajectories that a user makes by hand."""
    return by_hand(planned(logs, logs.parent / "hand"), logs.parent / "runs")


class _Nodes:
    """Three nodes of one core; one that is killed is replaced."""

    def __init__(self, cluster: Any) -> None:
        self._cluster = cluster
        self._nodes = [add_node(cluster) for _ in range(_NODES)]

    def kill_that_of(self, service: psutil.Process) -> None:
        above = {each.pid for each in service.parents()}
        (node,) = (each for each in self._nodes if _raylet(each) in above)
        self._nodes.remove(node)
        self._cluster.remove_node(node, allow_graceful=False)
        self._nodes.append(add_node(self._cluster))


def _raylet(node: Any) -> int:
    (raylet,) = node.all_processes["raylet"]
    return raylet.process.pid


def _kill_while(batch: Batch, run: subprocess.Popen, kill: Callable[[psutil.Process], None]) -> int:
    """Kill something of ten runs that are at work, and wait until each is gone; how many there were."""
    killed = 0
    while killed < _KILLS and run.poll() is None:
        for service in services(batch)[:1]:
            with contextlib.suppress(psutil.Error, ValueError):  # it has just ended
                kill(service)
                killed += 1
                wait(lambda one=service: not one.is_running() or _is_zombie(one))
    return killed


def _is_zombie(process: psutil.Process) -> bool:
    try:
        return process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def _expect_whole(
    batch: Batch, run: subprocess.Popen[str], expected: dict[str, bytes], pools: set[Path]
) -> None:
    said = end(run)
    assert run.returncode == 0 and f"{_LOGS} done, 0 failed, 0 left" in said, said
    assert "raylet" not in said
    assert trajectories(batch) == expected
    rows = read_runs(batch.out)
    assert sorted(row["name"] for row in rows) == sorted(expected)  # one row a log
    wait(lambda: nothing_left(batch, pools))
    assert not batch.work.exists() and not [*batch.out.glob("failed/*")]


@pytest.mark.parametrize("victim", ["run", "worker", "node"])
def test_killed_below_the_driver(cluster, logs: Path, expected, tmp_path: Path, pools, victim: str):
    batch, nodes = planned(logs, tmp_path / "out"), _Nodes(cluster)
    kill: dict[str, Callable[[psutil.Process], None]] = {
        "run": lambda service: service.kill(),
        "worker": lambda service: worker_of(service).kill(),
        "node": nodes.kill_that_of,
    }
    at_once = "1" if victim == "node" else "2"  # another log could end while a node starts
    run = start(batch, "--address", cluster.address, "--parallel", at_once, *_RETRIES)
    killed = _kill_while(batch, run, kill[victim])
    _expect_whole(batch, run, expected, pools)
    assert killed == _KILLS
    assert sum(row["attempt"] - 1 for row in read_runs(batch.out)) == _KILLS


def test_the_driver_is_killed(cluster, logs: Path, expected, tmp_path: Path, pools):
    batch = planned(logs, tmp_path / "out")
    _Nodes(cluster)
    done: dict[str, int] = {}
    for _ in range(_KILLS):
        run = start(batch, "--address", cluster.address, "--parallel", "1")
        wait(lambda run=run: services(batch) or run.poll() is not None)
        assert run.poll() is None
        os.kill(run.pid, signal.SIGKILL)
        end(run)
        wait(lambda: nothing_left(batch, pools))
        done |= _done_ns(batch)
    _expect_whole(batch, start(batch, "--address", cluster.address), expected, pools)
    assert {log_id: _done_ns(batch)[log_id] for log_id in done} == done  # not made again


def _done_ns(batch: Batch) -> dict[str, int]:
    """When each result was written, by id of its log."""
    files = {log.id: batch.done_file(log.id) for log in read_manifest(batch.out)}
    return {log_id: file.stat().st_mtime_ns for log_id, file in files.items() if file.exists()}
