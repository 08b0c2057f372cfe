"""The progress of a running batch: a bar for people, `progress.jsonl` for programs."""

import math
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, TextIO, cast

import msgspec
from rich.progress import BarColumn, TextColumn

from hsslam_batch.attempt.outcome import Outcome
from hsslam_batch.plan.batch import Batch
from hsslam_batch.results.metrics import MetricsFile
from hsslam_batch.results.tally import Tally
from hsslam_services.commands.cli import terminal_progress
from hsslam_services.run.resilient_stream import ResilientStream

PROGRESS = "progress.jsonl"
_LINE_EVERY_S = 60.0  # without a terminal
_DRAIN_S = 2.0


class BatchProgress:
    """Shows and writes the events of a batch; a line of `progress.jsonl` has the counts after its event.

    If a later write fails, the command prints one warning for each reason and the batch continues. If stderr
    is full, not read, or its reader is gone, lines are lost and the batch continues.

    Raises:
        OSError: the folder or the store of the batch is not writable at the start.
    """

    def __init__(self, batch: Batch, tally: Tally, metrics_file: Path | None = None) -> None:
        self.tally = tally
        self._metrics = MetricsFile(metrics_file, batch.about)
        self._metrics_name = str(metrics_file)
        self._batch = batch
        if batch.store is not None:
            before = batch.store.read_all([PROGRESS]).get(PROGRESS, b"")
            (batch.out / PROGRESS).write_bytes(before)
        self._file = (batch.out / PROGRESS).open("ab", buffering=0)
        self._published_s = -math.inf
        columns = (BarColumn(), TextColumn("{task.description}", markup=False))
        self._stream = ResilientStream(sys.stderr)
        self._bar = terminal_progress(*columns, file=cast(TextIO, self._stream))
        self._task = self._bar.add_task("", total=tally.frames)
        self._printed_s = time.monotonic()
        self._warned: set[str] = set()  # reasons of failed writes

    def __enter__(self) -> "BatchProgress":
        self._bar.start()
        self._write("begin")
        self.look({})
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self.look({})
        self._write("end")
        self._try(self._metrics_name, lambda: self._metrics.write(self.tally, running=0))
        self._bar.stop()
        self._stream.drain(_DRAIN_S)
        self._file.close()

    def look(self, frames: Mapping[str, int]) -> None:
        """Show the progress; `frames`: frames that are done, by id of the running log."""
        self.tally.run(frames)
        self._try(self._metrics_name, lambda: self._metrics.tick(self.tally, len(frames)))
        self._bar.update(
            self._task,
            total=self.tally.frames,
            completed=self.tally.frames_done,
            description=self.tally.line(),
        )
        if self._bar.disable and time.monotonic() - self._printed_s >= _LINE_EVERY_S:
            self._printed_s = time.monotonic()
            self.say(self.tally.line())

    def settled(self, outcome: Outcome) -> None:
        """Record a log that is done or has failed for good."""
        self.tally.settle(outcome)
        self._write("done" if outcome.is_done else "failed", outcome)
        if not outcome.is_done:
            self.say(outcome.failure)

    def left(self, outcome: Outcome) -> None:
        """Record a log whose last attempt has ended without a row, so that the next `run` takes it."""
        self._write("left", outcome)
        self.say(outcome.failure)

    def tried_again(self, outcome: Outcome) -> None:
        """Record a failed attempt whose log is tried again."""
        self.tally.tried_again += 1
        self._write("again", outcome)

    def say(self, text: str) -> None:
        """Print a line on stderr, above the bar."""
        if self._bar.disable:
            self._stream.write(f"{text}\n")
        else:
            self._bar.console.print(text, markup=False, highlight=False, soft_wrap=True)

    def _write(self, event: str, outcome: Outcome | None = None) -> None:
        tally = self.tally
        line: dict[str, Any] = {"time_ns": time.time_ns(), "event": event}
        if outcome is not None:
            names = ("id", "name", "attempt", "kind", "reason", "node", "wall_s", "core_s")
            line |= {name: getattr(outcome, name) for name in names}
        counts = ("logs", "done", "failed", "left", "tried_again", "frames", "frames_done")
        line |= {name: getattr(tally, name) for name in counts}
        text = msgspec.json.encode(line | {"rest_s": tally.rest_s()}) + b"\n"
        self._try(PROGRESS, lambda: self._file.write(text))
        if event == "end" or time.monotonic() - self._published_s >= _LINE_EVERY_S:
            self._published_s = time.monotonic()
            self._try(PROGRESS, lambda: self._batch.publish(PROGRESS))

    def _try(self, name: str, write: Callable[[], object]) -> None:
        """Call a write of a report; after an OSError warn once for each reason."""
        try:
            write()
        except OSError as error:
            reason = f"{name}: {error.strerror or error}"
            if reason not in self._warned:
                self._warned.add(reason)
                self.say(f"warning: {reason}: not written; the batch continues")
