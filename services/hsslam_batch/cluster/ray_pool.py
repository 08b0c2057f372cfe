"""Attempts as tasks of Ray: never more in flight than twice what fits, each with its cores and memory."""

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import ray
from ray.exceptions import RayError, RayTaskError
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from hsslam_batch.cluster.board import Board, Running
from hsslam_batch.cluster.drive import Try
from hsslam_batch.cluster.task import TaskResult
from hsslam_node.errors import UserError

_AHEAD = 2  # tasks in flight for each slot: the next is there when one ends
_COUNT_EVERY_S = 5.0
_ANSWER_S = 10.0
_LOST = {
    "WorkerCrashedError": "its worker process died",
    "NodeDiedError": "its node died",
    "OutOfMemoryError": "its node ran out of memory, and Ray ended it",
    "ActorDiedError": "the board of the batch died",
}


@dataclass(frozen=True)
class Share:
    """What a log takes of a node."""

    cpus: float
    memory_gb: float

    @property
    def memory_bytes(self) -> int:
        return int(1e9 * self.memory_gb)


class RayPool:
    """The nodes that Ray knows now; `task`: what runs there, as `perform` in `task.py`.

    `most`: at most so many at once (None: as many as fit).

    Raises:
        UserError: no node has room for one.
    """

    def __init__(
        self,
        task: Callable[..., TaskResult],
        arguments: Callable[[Try], Sequence[str]],
        share: Share,
        most: int | None,
    ) -> None:
        self._task: Any = ray.remote(max_retries=0)(task)
        self._arguments = arguments
        self._share = share
        self._most = most
        # only here: Ray may put it elsewhere otherwise, and that node's death would fail all that run
        here = NodeAffinitySchedulingStrategy(ray.get_runtime_context().get_node_id(), soft=False)
        board = ray.remote(num_cpus=0, max_restarts=0)(Board)
        self.board: Any = board.options(scheduling_strategy=here).remote()
        self._anywhere: Any = self._placed("DEFAULT")
        self._flying: dict[Any, Try] = {}
        self._counted_s = -_COUNT_EVERY_S
        self._slots = 0
        if not self.slots():
            raise UserError(
                f"--cpus {share.cpus:g} --memory {share.memory_gb:g}: no node has as much: expected at "
                f"most {_largest()}"
            )

    def slots(self) -> int:
        """How many fit on all nodes that are alive; counted anew every few seconds."""
        if time.monotonic() - self._counted_s >= _COUNT_EVERY_S:
            self._counted_s = time.monotonic()
            self._slots = sum(_fitting(node, self._share) for node in _alive())
        return self._slots if self._most is None else min(self._slots, self._most)

    def has_room(self) -> bool:
        slots = self.slots()
        most = _AHEAD * slots if self._most is None else min(_AHEAD * slots, self._most)
        return len(self._flying) < most

    def is_busy(self) -> bool:
        return bool(self._flying)

    def start(self, one: Try) -> None:
        task = self._elsewhere(one.not_on) if one.not_on else self._anywhere
        self._flying[task.remote(self._arguments(one), one.index, self.board)] = one

    def ended(self, timeout_s: float) -> Iterator[tuple[Try, TaskResult]]:
        if not self._flying:
            time.sleep(timeout_s)  # no node is there at the moment: Ray reports none that comes
            return
        if not ray.wait(list(self._flying), timeout=timeout_s)[0]:
            return
        everything = list(self._flying)
        for ref in ray.wait(everything, num_returns=len(everything), timeout=0)[0]:
            one = self._flying.pop(ref)
            yield one, self._result(ref, one)

    def running(self) -> dict[int, Running]:
        """What runs now, by index of the log; empty if the board does not answer."""
        with contextlib.suppress(RayError):
            return ray.get(self.board.running.remote(), timeout=_ANSWER_S)
        return {}

    def close(self) -> None:
        """Let no task begin that has not begun."""
        self.board.close.remote()

    def _result(self, ref: Any, one: Try) -> TaskResult:
        ended = self.board.end.remote(one.index)  # only a task without a result needs the answer
        try:
            return ray.get(ref)
        except RayTaskError as error:
            trouble, is_lost = f"task failed: {error.cause!r}", False
        except RayError as error:
            kind = type(error).__name__
            trouble, is_lost = _LOST.get(kind, kind), True
        node_id: Any = ""
        with contextlib.suppress(RayError):
            node_id = ray.get(ended, timeout=_ANSWER_S)
        return TaskResult(trouble=trouble, is_lost=is_lost, node_id=node_id)

    def _placed(self, strategy: Any) -> Any:
        """The task with what it takes of a node, and where it may run."""
        return self._task.options(
            num_cpus=self._share.cpus,
            memory=self._share.memory_bytes,
            scheduling_strategy=strategy,
        )

    def _elsewhere(self, not_on: str) -> Any:
        """The task on another node than this, if there is one that is large enough."""
        for node in _alive():
            if node["NodeID"] != not_on and _fitting(node, self._share):
                return self._placed(NodeAffinitySchedulingStrategy(node["NodeID"], soft=True))
        return self._anywhere


def _alive() -> list[dict[str, Any]]:
    return [node for node in ray.nodes() if node["Alive"]]


def _fitting(node: dict[str, Any], share: Share) -> int:
    has = node["Resources"]
    by_cpu = has.get("CPU", 0.0) / share.cpus
    return int(min(by_cpu, has.get("memory", 0.0) / share.memory_bytes) + 1e-9)


def _largest() -> str:
    cpus = max((node["Resources"].get("CPU", 0.0) for node in _alive()), default=0.0)
    memory = max((node["Resources"].get("memory", 0.0) for node in _alive()), default=0.0)
    return f"{cpus:g} cores and {memory / 1e9:.1f} GB"
