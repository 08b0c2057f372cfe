"""One `hsslam-batch run`: records each attempt that has ended, and shows the progress of the others."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import msgspec

from hsslam_batch.attempt.commit import settle_failed, settled
from hsslam_batch.attempt.outcome import Kind, Outcome, may_try_again
from hsslam_batch.cluster.board import Running
from hsslam_batch.cluster.drive import Try
from hsslam_batch.cluster.task import TaskResult
from hsslam_batch.options import RunOptions
from hsslam_batch.plan.batch import Batch, OtherPlanError
from hsslam_batch.plan.log import Log
from hsslam_batch.results.progress import BatchProgress

_MOST_UNAVAILABLE = 3  # logs, one after the other


class Watched(Protocol):
    """What a batch asks of the pool while tasks run."""

    def running(self) -> Mapping[int, Running]: ...

    def close(self) -> None: ...


class Stop:
    """Whether the batch should stop: no log can start, or a signal came, possibly in the middle of a call."""

    def __init__(self) -> None:
        self._is_asked = False

    def ask(self) -> None:
        """Ask the batch to stop."""
        self._is_asked = True

    def is_asked(self) -> bool:
        """Whether the batch should stop."""
        return self._is_asked


@dataclass
class BatchRun:
    """One `hsslam-batch run`; `drive` calls `judge` and `look`."""

    batch: Batch
    logs: Sequence[Log]
    retries: int
    pool: Watched
    progress: BatchProgress
    stop: Stop
    _is_closed: bool = field(default=False, init=False)
    _unavailable: int = field(default=0, init=False)  # logs that ended so, one after the other

    def judge(self, one: Try, result: TaskResult) -> Try | None:
        """Record the outcome of an attempt; returns the next attempt if the log gets one.

        If the log could not start, no other log starts; likewise once a store or a disk has failed for the
        last attempts at three logs one after the other. These logs are left.
        """
        trouble = self._other_code(result) if result.is_begun else result.trouble
        if trouble or not result.is_begun:
            if trouble and not self.stop.is_asked():
                self.progress.say(f"error: {trouble}")
                self.stop.ask()
            return None
        outcome = result.outcome or self._without_result(one, result)
        if may_try_again(outcome, self.retries):
            if outcome.kind != "unavailable":
                self._unavailable = 0
            self.progress.tried_again(outcome)
            return Try(one.index, one.attempt + 1, result.node_id)
        if outcome.kind == "unavailable":
            self._leave(outcome)
            return None
        self._unavailable = 0
        self.progress.settled(outcome)
        return None

    def look(self) -> None:
        """Show the progress; once the batch should stop, keep waiting tasks from starting."""
        if self.stop.is_asked() and not self._is_closed:
            self._is_closed = True
            self.pool.close()
            self.progress.say("no more logs start, running logs finish; Ctrl-C stops them now")
        running = self.pool.running().items()
        self.progress.look({self.logs[index].id: now.frames for index, now in running})

    def _leave(self, outcome: Outcome) -> None:
        """Leave a log to the next `run`; ask the batch to stop if the logs before it have ended so, too."""
        self.progress.left(outcome)
        self._unavailable += 1
        if self._unavailable >= _MOST_UNAVAILABLE and not self.stop.is_asked():
            self.progress.say(
                f"error: {self._unavailable} logs one after the other could not be fetched, or their results "
                "not written: expected stores and disks that work"
            )
            self.stop.ask()

    def _other_code(self, result: TaskResult) -> str:
        """Why an attempt without an outcome is no failure of its log: its code was edited after the plan;
        empty if the code is the same."""
        if result.outcome is None and not result.is_lost and not result.is_unavailable:
            try:
                self.batch.expect_same_code()
            except OtherPlanError as error:
                return str(error)
        return ""

    def _without_result(self, one: Try, result: TaskResult) -> Outcome:
        """The row of an attempt that has not written one; `unavailable` if it cannot be written now."""
        log = self.logs[one.index]
        outcome = Outcome(
            id=log.id,
            name=log.name,
            configuration=self.batch.about.configuration,
            attempt=one.attempt,
            retries=self.retries,
            kind=_kind(result),
            reason=result.trouble,
            code=self.batch.about.code,
            started_ns=time.time_ns(),
        )
        if result.is_unavailable:
            return outcome  # the next attempt first reads the row
        try:
            settle_failed(self.batch, outcome)
            return settled(self.batch, log.id) or outcome  # it may have committed before it died
        except OSError as error:
            reason = f"{result.trouble}; not written: {error.strerror or error}"
            return msgspec.structs.replace(outcome, kind="unavailable", reason=reason)


def _kind(result: TaskResult) -> Kind:
    """The kind of an attempt that has not written its outcome."""
    if result.is_unavailable:
        return "unavailable"
    if result.is_out_of_memory:
        return "out of memory"
    return "lost" if result.is_lost else "crash"


def work_words(batch: Batch, logs: Sequence[Log], options: RunOptions, one: Try) -> list[str]:
    """The arguments of `hsslam-batch work` for an attempt."""
    words = [batch.place, "--index", str(one.index), "--id", logs[one.index].id]
    words += ["--attempt", str(one.attempt)]
    given = {
        "--retries": options.retries,
        "--memory": options.memory_gb,
        "--timeout": options.timeout_s,
        "--scratch": options.scratch,
        "--fetch-gb": options.fetch_gb,
        "--patience": options.patience_s,
    }
    for flag, value in given.items():
        words += [] if value is None else [flag, str(value)]
    return words
