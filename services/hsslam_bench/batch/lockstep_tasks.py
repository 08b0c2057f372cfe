"""Rows of lockstep runs, several at once: their runs are tasks of Ray, on one machine or many.

A row is asked for its figures again and again. Each time it comes to the first run that is not there yet;
that run becomes a task, if it is none, and the row waits for it.
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
    """The run goes on."""


def measure_as_tasks(
    checks: Sequence[Check], session: Session, address: str, keep: Callable[[Row], None]
) -> None:
    """Measure rows that are `is_lockstep`, and keep each once its runs are there.

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
    """The runs that go on, and those that failed, by name."""

    def __init__(self) -> None:
        import ray

        remote = ray.remote(num_cpus=_CPUS, memory=_MEMORY_BYTES, max_retries=0)
        self._task: Any = remote(run_task)
        self._flying: dict[Any, str] = {}
        self._failed: dict[str, RunFailedError] = {}

    def make(self, name: str, folder: Path, options: Sequence[str], *_: Any, **__: Any) -> Never:
        """In the place of `serve`: start a run, if it does not go on.

        Raises:
            RunFailedError: it has failed.
            _NotYetError: otherwise.
        """
        if name in self._failed:
            raise self._failed[name]
        if name not in self._flying.values():
            ref = self._task.remote(name, str(folder), list(options))
            self._flying[ref] = name
        raise _NotYetError(name)

    def next_ended(self) -> dict[str, ServeRun]:
        """The next run that ends; empty if it failed."""
        import ray
        from ray.exceptions import RayError, RayTaskError

        (ref,), _ = ray.wait(list(self._flying))
        name = self._flying.pop(ref)
        try:
            return {name: ray.get(ref)}
        except RayTaskError as error:
            self._failed[name] = RunFailedError(str(error.cause))
        except RayError as error:
            self._failed[name] = RunFailedError(f"{name}: {type(error).__name__}")
        return {}
