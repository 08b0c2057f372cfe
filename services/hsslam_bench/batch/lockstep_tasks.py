"""Measures rows of lockstep runs with several runs at once, as tasks of Ray on one machine or many.

Each row is measured repeatedly. Each time it stops at the first run without a result; that run becomes a
task, and the row waits for it.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Never

from hsslam_batch.cluster.connect import connected
from hsslam_bench.batch.run_task import run_task
from hsslam_bench.checks.check import Check, Row, perform
from hsslam_bench.runs.serve_run import RunFailedError, ServeRun, serve
from hsslam_bench.runs.session import Session

_CPUS, _MEMORY_BYTES = 1, 4 * 10**9  # of a run, as hsslam-batch has it


class _NotYetError(Exception):
    """The run has no result yet."""


def measure_as_tasks(
    checks: Sequence[Check], session: Session, address: str, keep: Callable[[Row], None]
) -> None:
    """Measure `is_lockstep` rows; call `keep` for each row when its runs are complete.

    Raises:
        UserError: no Ray at the address.
    """
    session.warm_up()
    waiting = list(checks)
    with connected(address):
        tasks = _Tasks()
        session.make = tasks.make
        try:
            while waiting:
                waiting = [check for check in waiting if not _is_measured(check, session, keep)]
                if waiting:
                    session.say(f"{len(waiting)} rows wait for runs")
                    session.runs.update(tasks.next_ended())
        finally:
            session.make = serve


def _is_measured(check: Check, session: Session, keep: Callable[[Row], None]) -> bool:
    try:
        keep(perform(check, session))
    except _NotYetError:
        return False
    return True


class _Tasks:
    """The running tasks, and the runs that failed, by name of the run."""

    def __init__(self) -> None:
        import ray

        remote = ray.remote(num_cpus=_CPUS, memory=_MEMORY_BYTES, max_retries=0)
        self._task: Any = remote(run_task)
        self._running: dict[Any, str] = {}
        self._failed: dict[str, RunFailedError] = {}

    def make(self, name: str, folder: Path, options: Sequence[str], *_: Any, **__: Any) -> Never:
        """Replaces `serve`: start a run unless it is running.

        Raises:
            RunFailedError: the run has failed.
            _NotYetError: the run has no result yet.
        """
        if name in self._failed:
            raise self._failed[name]
        if name not in self._running.values():
            ref = self._task.remote(name, str(folder), list(options))
            self._running[ref] = name
        raise _NotYetError(name)

    def next_ended(self) -> dict[str, ServeRun]:
        """Wait for the next run that ends; empty if it failed."""
        import ray
        from ray.exceptions import RayError, RayTaskError

        (ref,), _ = ray.wait(list(self._running))
        name = self._running.pop(ref)
        try:
            return {name: ray.get(ref)}
        except RayTaskError as error:
            self._failed[name] = RunFailedError(str(error.cause))
        except RayError as error:
            self._failed[name] = RunFailedError(f"{name}: {type(error).__name__}")
        return {}
