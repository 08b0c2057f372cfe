"""`hsslam-batch run` through Ray's client server, as from a machine that is no node of the cluster.

It takes minutes, so it has the mark `long`: `pytest -m long tests/batch`.
"""

import os
import signal
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hsslam_batch.plan.batch import Batch
from hsslam_batch.results.runs_table import read_runs
from hsslam_bench.batch.ray_nodes import add_node, ray_cluster
from hsslam_bench.batch.small_log import write_small_log
from tests.batch.cluster.runs_of_batch import (
    end,
    nothing_left,
    planned,
    services,
    start,
    trajectories,
    wait,
)

pytestmark = [pytest.mark.e2e, pytest.mark.long, pytest.mark.timeout(3600)]
_SAME = ("name", "kind", "attempt", "frames", "tracked", "lost", "keyframes", "mesh_faces")


@pytest.fixture
def addresses() -> Iterator[tuple[str, str]]:
    """A cluster of one node with a client server: HOST:PORT of its head, and ray://HOST:PORT."""
    with socket.create_server(("", 0)) as free:
        port = free.getsockname()[1]
    with ray_cluster(ray_client_server_port=port) as cluster:
        add_node(cluster)
        wait(lambda: _listens(port))
        yield cluster.address, f"ray://127.0.0.1:{port}"


def _listens(port: int) -> bool:
    with socket.socket() as peer:
        return peer.connect_ex(("127.0.0.1", port)) == 0


def _good_and_damaged(folder: Path, out: str) -> Batch:
    """The plan of a good log and a damaged one."""
    if not (folder / "logs").exists():
        write_small_log(folder / "logs" / "good", count=4)
        log = write_small_log(folder / "logs" / "damaged", count=1)
        log.write_bytes(b"no log" + log.read_bytes())
    return planned(folder / "logs", folder / out)


def test_each_kind_of_address_makes_the_same(
    addresses: tuple[str, str], tmp_path: Path, pools: set[Path], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("RAY_ADDRESS", addresses[1])  # for auto alone
    made: list[Any] = []
    for address in (*addresses, "auto"):
        batch = _good_and_damaged(tmp_path, f"out{len(made)}")
        said = end(run := start(batch, "--address", address))
        assert run.returncode == 3 and "1 done, 1 failed, 0 left" in said, said
        assert "damaged: bad input: " in said and "Traceback" not in said, said
        rows = [{name: row[name] for name in _SAME} for row in read_runs(batch.out)]
        made.append((rows, trajectories(batch)))
        assert nothing_left(batch, pools) and not batch.work.exists()
    assert made[0] == made[1] == made[2]


def test_a_killed_client_leaves_what_the_next_run_does(
    addresses: tuple[str, str], tmp_path: Path, pools: set[Path]
):
    """The client server waits for it for a while, and then ends what it has started."""
    batch = _good_and_damaged(tmp_path, "out")
    run = start(batch, "--address", addresses[1])
    wait(lambda: services(batch) or run.poll() is not None)
    (service,) = services(batch)
    service.suspend()  # the log cannot finish meanwhile
    os.kill(run.pid, signal.SIGKILL)
    end(run)
    wait(lambda: not service.parent() or service.parent().pid == 1)
    service.resume()
    wait(lambda: nothing_left(batch, pools))
    said = end(second := start(batch, "--address", addresses[1]))
    assert second.returncode == 3 and "1 done, 1 failed, 0 left" in said, said
    rows = {row["name"]: (row["kind"], row["attempt"]) for row in read_runs(batch.out)}
    assert rows == {"good": ("done", 1), "damaged": ("bad input", 1)}
    assert nothing_left(batch, pools)
