"""Runs attempts as tasks of Ray, each with its cores and memory; submits at most twice as many as fit."""

import contextlib
import random
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import ray
from ray.exceptions import ActorDiedError, RayError, RayTaskError, TaskCancelledError
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from hsslam_batch.cluster.board import Board, Running
from hsslam_batch.cluster.drive import Try
from hsslam_batch.cluster.task import TaskResult
from hsslam_node.errors import UserError

_AHEAD = 2  # submitted tasks a slot, so that the next is ready when one ends
_COUNT_EVERY_S = 5.0
_ANSWER_S = 10.0
_OUT_OF_MEMORY = "OutOfMemoryError"
_LOST = {
    "WorkerCrashedError": "its worker process died",
    "NodeDiedError": "its node died",
    _OUT_OF_MEMORY: "its node ran out of memory, and Ray killed it: expected more --memory",
}


@dataclass(frozen=True)
class Share:
    """Cores and memory that a log takes of a node."""

    cpus: float
    memory_gb: float

    @property
    def memory_bytes(self) -> int:
        return int(1e9 * self.memory_gb)


class RayPool:
    """The nodes that Ray has now; `task`: the function to run there, as `perform` in `task.py`.

    `most`: most tasks at once (None: as many as fit).

    Raises:
        UserError: no node has room for a task.
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
        # on this node: if the board's node dies, all running tasks fail
        here = NodeAffinitySchedulingStrategy(ray.get_runtime_context().get_node_id(), soft=False)
        board = ray.remote(num_cpus=0, max_restarts=0)(Board)
        self.board: Any = board.options(scheduling_strategy=here).remote()
        self._anywhere: Any = self._placed("DEFAULT")
        self._submitted: dict[Any, Try] = {}
        self._counted_s = -_COUNT_EVERY_S
        self._slots = 0
        if not self.slots():
            raise UserError(
                f"--cpus {share.cpus:g} --memory {share.memory_gb:g}: more than any node has: expected at "
                f"most {_largest()}"
            )

    def slots(self) -> int:
        """Number of tasks that fit on all live nodes; counted every `_COUNT_EVERY_S`."""
        if time.monotonic() - self._counted_s >= _COUNT_EVERY_S:
            self._counted_s = time.monotonic()
            self._slots = sum(_fitting(node, self._share) for node in _alive())
        return self._slots if self._most is None else min(self._slots, self._most)

    def has_room(self) -> bool:
        slots = self.slots()
        most = _AHEAD * slots if self._most is None else min(_AHEAD * slots, self._most)
        return len(self._submitted) < most

    def is_busy(self) -> bool:
        return bool(self._submitted)

    def start(self, one: Try) -> None:
        task = self._elsewhere(one.not_on) if one.not_on else self._anywhere
        self._submitted[task.remote(self._arguments(one), one.index, self.board)] = one

    def ended(self, timeout_s: float) -> Iterator[tuple[Try, TaskResult]]:
        if not self._submitted:
            time.sleep(timeout_s)  # no node now, and Ray does not report new ones
            return
        if not ray.wait(list(self._submitted), timeout=timeout_s)[0]:
            return
        everything = list(self._submitted)
        for ref in ray.wait(everything, num_returns=len(everything), timeout=0)[0]:
            one = self._submitted.pop(ref)
            yield one, self._result(ref, one)

    def running(self) -> dict[int, Running]:
        """Running tasks, by index of the log; empty if the board does not answer."""
        with contextlib.suppress(RayError):
            return ray.get(self.board.running.remote(), timeout=_ANSWER_S)
        return {}

    def close(self) -> None:
        """Let no further task start; cancel those that wait, for which there may never be a node again."""
        self.board.close.remote()
        with contextlib.suppress(RayError):  # without the board, none is known to wait
            begun = ray.get(self.board.running.remote(), timeout=_ANSWER_S)
            for ref, one in self._submitted.items():
                if one.index not in begun:
                    ray.cancel(ref)

    def _result(self, ref: Any, one: Try) -> TaskResult:
        ended = self.board.end.remote(one.index)  # only a task without a result needs the answer
        try:
            return ray.get(ref)
        except RayTaskError as error:
            if isinstance(error.cause, ActorDiedError):  # no log can start without it
                return TaskResult(trouble="the board of the batch died", is_begun=False)
            trouble, kind = f"task failed: {error.cause!r}", ""
        except TaskCancelledError:
            return TaskResult(is_begun=False)
        except RayError as error:
            kind = type(error).__name__
            trouble = _LOST.get(kind, kind)
        node_id: Any = ""
        with contextlib.suppress(RayError):
            node_id = ray.get(ended, timeout=_ANSWER_S)
        return TaskResult(
            trouble=trouble,
            is_lost=bool(kind),
            is_out_of_memory=kind == _OUT_OF_MEMORY,
            node_id=node_id,
        )

    def _placed(self, strategy: Any) -> Any:
        """The task with its cores, memory and placement."""
        return self._task.options(
            num_cpus=self._share.cpus,
            memory=self._share.memory_bytes,
            scheduling_strategy=strategy,
        )

    def _elsewhere(self, not_on: str) -> Any:
        """The task on another node, if one is large enough; else on any.

        Ray lets the task wait for this node, so each gets one at random.
        """
        ids = [node["NodeID"] for node in _alive() if _fitting(node, self._share)]
        others = [node_id for node_id in ids if node_id != not_on]
        if not others:
            return self._anywhere
        return self._placed(NodeAffinitySchedulingStrategy(random.choice(others), soft=True))


def _alive() -> list[dict[str, Any]]:
    return [node for node in ray.nodes() if node["Alive"]]


def _fitting(node: dict[str, Any], share: Share) -> int:
    has = node["Resources"]
    by_cpu = has.get("CPU", 0.0) / share.cpus
    return int(min(by_cpu, has.get("memory", 0.0) / share.memory_bytes) + 1e-9)


def _largest() -> str:
    """Cores and memory of the node with most cores; if several have as many, of the one with most memory."""
    nodes = [node["Resources"] for node in _alive()]
    cpus, memory = max((has.get("CPU", 0.0), has.get("memory", 0.0)) for has in nodes or [{}])
    return f"{cpus:g} cores and {memory / 1e9:.1f} GB"
