"""Tasks on a real Ray cluster: what is killed is told as lost, what is left goes on elsewhere."""

from collections import Counter
from pathlib import Path
from typing import Any

import msgspec
import pytest
import ray

from hsslam_batch.attempt.outcome import Outcome, Refused
from hsslam_batch.cluster.connect import connected
from hsslam_batch.cluster.drive import Try, drive
from hsslam_batch.cluster.ray_pool import RayPool, Share
from hsslam_batch.cluster.task import TaskResult, perform_command
from hsslam_bench.batch.ray_nodes import add_node
from hsslam_node.errors import UserError

pytestmark = [pytest.mark.e2e, pytest.mark.xdist_group("ray")]  # one cluster at a time


def _task(folder: Path):
    """A task that begins as ours do; the first attempt at log 1 kills its worker, at log 2 waits."""

    def task(arguments: list[str], index: int, board: Any) -> TaskResult:
        import os
        import signal
        import time

        import ray

        node_id = ray.get_runtime_context().get_node_id()
        if not ray.get(board.begin.remote(index, node_id)):
            return TaskResult(is_begun=False)
        attempt = int(arguments[0])
        (folder / f"{index}.{attempt}").write_text(node_id)
        if (index, attempt) == (1, 1):
            os.kill(os.getpid(), signal.SIGKILL)
        while (index, attempt) == (2, 1):
            time.sleep(0.1)
        outcome = Outcome(str(index), "log", "configuration", attempt, "done")
        return TaskResult(outcome, node_id=node_id)

    return task


def test_a_killed_worker_and_a_killed_node_cost_an_attempt_and_no_log(cluster, tmp_path: Path):
    nodes = [add_node(cluster) for _ in range(2)]
    results: list[tuple[Try, TaskResult]] = []

    def judge(one: Try, result: TaskResult) -> Try | None:
        results.append((one, result))
        return Try(one.index, one.attempt + 1, result.node_id) if result.is_lost else None

    def look() -> None:
        started = tmp_path / "2.1"
        if started.exists() and nodes and (node_id := started.read_text()):
            (node,) = [node for node in nodes if node.node_id == node_id]
            nodes.clear()
            cluster.remove_node(node, allow_graceful=False)

    with connected(cluster.address):
        share = Share(cpus=1.0, memory_gb=1.0)
        pool = RayPool(_task(tmp_path), lambda one: [str(one.attempt)], share, None)
        assert pool.slots() == 2
        _expect_elsewhere(pool, [node.node_id for node in nodes])
        drive(map(Try, range(6)), pool, judge, lambda: False, look)
        assert pool.running() == {}
    lost = {(one.index, one.attempt): result for one, result in results if result.is_lost}
    assert {(1, 1), (2, 1)} <= set(lost)  # and perhaps one that was just sent to the node
    assert all("died" in result.trouble for result in lost.values())
    losses = Counter(index for index, _ in lost)
    done = [(one.index, one.attempt) for one, result in results if result.outcome]
    assert sorted(done) == [(index, 1 + losses[index]) for index in range(6)]
    for index in (1, 2):
        assert lost[index, 1].node_id == (tmp_path / f"{index}.1").read_text()
    assert (tmp_path / "2.1").read_text() != (tmp_path / "2.2").read_text()  # its node is gone


def _expect_elsewhere(pool: RayPool, node_ids: list[str]) -> None:
    """An attempt that avoids a node runs on the other; by chance one in two would."""
    for not_on in 4 * node_ids:
        pool.start(Try(0, 2, not_on))
        ended: list[tuple[Try, TaskResult]] = []
        while pool.is_busy():
            ended += pool.ended(0.5)
        assert [result.node_id != not_on for _, result in ended] == [True]


def test_no_more_begins_after_a_stop_and_no_node_is_too_small(cluster, tmp_path: Path):
    add_node(cluster, memory_gb=2.0)
    begun: list[int] = []
    refusals: list[TaskResult] = []
    with connected(cluster.address):
        with pytest.raises(
            UserError, match=r"than any node has: expected at most 1 cores and 2\.0 GB"
        ):
            RayPool(_task(tmp_path), lambda one: ["2"], Share(1.0, memory_gb=3.0), None)
        share = Share(1.0, memory_gb=1.0)
        pool = RayPool(_task(tmp_path), lambda one: ["2"], share, None)
        pool.close()

        def judge(one: Try, result: TaskResult) -> None:
            if result.is_begun:
                begun.append(one.index)

        drive(map(Try, range(3)), pool, judge, lambda: False)
        assert begun == []
        line = msgspec.json.encode(Refused("other code")).decode()
        much_first = 'head -c 1000000 /dev/zero >&2; echo "$0"'  # more than a pipe holds
        pool = RayPool(perform_command, lambda one: ["sh", "-c", much_first, line], share, None)
        drive([Try(0)], pool, lambda _, result: refusals.append(result), lambda: False)
        assert [(one.trouble, one.is_begun) for one in refusals] == [("other code", False)]


def test_the_death_of_the_board_costs_no_log(cluster, tmp_path: Path):
    add_node(cluster)
    with connected(cluster.address):
        pool = RayPool(_task(tmp_path), lambda one: [str(one.attempt)], Share(1.0, 1.0), None)
        ray.kill(pool.board)
        pool.start(Try(5))
        ended: list[tuple[Try, TaskResult]] = []
        while pool.is_busy():
            ended += pool.ended(0.5)
        pool.close()
    ((_, result),) = ended
    assert (result.is_begun, result.trouble) == (False, "the board of the batch died")
    assert not list(tmp_path.iterdir())


def test_a_task_that_waits_for_a_node_does_not_delay_a_stop(cluster, tmp_path: Path):
    node = add_node(cluster)
    with connected(cluster.address):
        pool = RayPool(_task(tmp_path), lambda one: [str(one.attempt)], Share(1.0, 1.0), None)
        pool.start(Try(2))  # waits for ever
        while not (tmp_path / "2.1").exists():
            list(pool.ended(0.1))
        pool.start(Try(3))
        pool.close()
        ended: list[tuple[Try, TaskResult]] = []
        while not ended:
            ended += pool.ended(0.5)
        assert [(one.index, result.is_begun) for one, result in ended] == [(3, False)]
        cluster.remove_node(node, allow_graceful=False)
        while pool.is_busy():
            ended += pool.ended(0.5)
    assert [(one.index, result.is_lost) for one, result in ended[1:]] == [(2, True)]
