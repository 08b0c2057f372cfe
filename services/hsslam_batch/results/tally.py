"""The progress of a batch in numbers: logs by state, frames done and of all logs, remaining time."""

import time
from collections.abc import Iterable, Mapping, Sequence

from hsslam_batch.attempt.outcome import Outcome
from hsslam_batch.plan.log import Log


class Tally:
    """Counts of a running batch.

    A log with an unknown number of frames counts as one of average length until it is settled.
    """

    def __init__(self, logs: Sequence[Log], settled: Iterable[Outcome]) -> None:
        known = [log.frames for log in logs if log.frames]
        average = sum(known) / len(known) if known else 1.0
        self._frames = {log.id: log.frames or average for log in logs}
        self._unknown = {log.id for log in logs if not log.frames}
        self.logs = len(logs)
        self.done = 0
        self.failed = 0
        self.tried_again = 0
        self.core_s = 0.0
        self._settled_frames = 0.0
        for outcome in settled:
            self.settle(outcome)
        self.core_s = 0.0  # of logs that end from now on
        self._begun_at_frames = self._settled_frames
        self._begun_s = time.monotonic()
        self._running_frames = 0.0

    @property
    def left(self) -> int:
        """Logs that are neither done nor failed."""
        return self.logs - self.done - self.failed

    @property
    def frames(self) -> int:
        """Frames of all logs."""
        return round(sum(self._frames.values()))

    @property
    def frames_done(self) -> int:
        """Frames of logs that are done or failed, and frames of running logs so far."""
        return round(self._settled_frames + self._running_frames)

    def settle(self, outcome: Outcome) -> None:
        """Count a log that is done or has failed for good."""
        self.done += outcome.is_done
        self.failed += not outcome.is_done
        self.core_s += outcome.core_s
        if outcome.id in self._unknown:
            self._frames[outcome.id] = outcome.frames
        self._settled_frames += self._frames[outcome.id]

    def run(self, frames: Mapping[str, int]) -> None:
        """Set the frames that are done, by id of the running log; frames of failed attempts drop out."""
        self._running_frames = sum(min(n, self._frames[i]) for i, n in frames.items())

    def rest_s(self) -> float | None:
        """Remaining time at the pace since the start, s; None before the first frame."""
        made = self._settled_frames + self._running_frames - self._begun_at_frames
        if made <= 0:
            return None
        pace_s = (time.monotonic() - self._begun_s) / made
        return pace_s * (self.frames - self.frames_done)

    def line(self) -> str:
        """All counts in one line."""
        rest_s = self.rest_s()
        rest = "" if rest_s is None or not self.left else f"; about {duration(rest_s)} left"
        return (
            f"{self.done} done, {self.failed} failed, {self.left} left; "
            f"{self.frames_done} of {self.frames} frames{rest}"
        )


def duration(seconds: float) -> str:
    """As `2 h 10 min`, `3 min`, `20 s`."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"
