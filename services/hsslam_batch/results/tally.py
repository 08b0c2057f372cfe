"""The progress of a batch in numbers: logs by state, frames done and of all logs, remaining time."""

import time
from collections.abc import Iterable, Mapping, Sequence

from hsslam_batch.attempt.outcome import Outcome
from hsslam_batch.plan.log import Log


class Tally:
    """Counts of a running batch.

    A log with an unknown number of frames counts as one of average length until it is settled, or with its
    frames so far if these are more. The average is that of all logs that are done or whose length is known.
    """

    def __init__(self, logs: Sequence[Log], settled: Iterable[Outcome]) -> None:
        self._known = {log.id: log.frames for log in logs if log.frames}
        self._unknown = {log.id for log in logs if not log.frames}
        self._lengths = len(self._known)  # of which the average is made
        self._length_frames = sum(self._known.values())
        self._failed_frames = 0  # of logs whose length stays unknown
        self.logs = len(logs)
        self.done = 0
        self.failed = 0
        self.tried_again = 0
        self.core_s = 0.0
        self._settled_frames = 0
        self._made_frames = 0  # by runs; a failed one may have made none of its log's frames
        self._running: Mapping[str, int] = {}
        for outcome in settled:
            self.settle(outcome)
        self.core_s = 0.0  # of logs that end from now on
        self._made_frames = 0  # from now on
        self._begun_s = time.monotonic()

    @property
    def left(self) -> int:
        """Logs that are neither done nor failed."""
        return self.logs - self.done - self.failed

    @property
    def frames(self) -> int | None:
        """Frames of all logs; None while some are left and no log has a known length."""
        if not self._unknown:
            return self._length_frames + self._failed_frames
        if not self._lengths:
            return None
        average = self._length_frames / self._lengths
        longer = sum(
            max(0.0, self._running[i] - average) for i in self._running.keys() & self._unknown
        )
        rest = average * len(self._unknown) + longer
        return round(self._length_frames + self._failed_frames + rest)

    @property
    def frames_done(self) -> int:
        """Frames of logs that are done or failed, and frames of running logs so far."""
        return self._settled_frames + self._running_frames()

    def settle(self, outcome: Outcome) -> None:
        """Count a log that is done or has failed for good."""
        self.done += outcome.is_done
        self.failed += not outcome.is_done
        self.core_s += outcome.core_s
        self._running = {i: n for i, n in self._running.items() if i != outcome.id}
        self._settled_frames += self._known.get(outcome.id, outcome.frames)
        self._made_frames += outcome.frames
        if outcome.id in self._unknown:
            self._unknown.remove(outcome.id)
            if outcome.is_done:
                self._lengths += 1
                self._length_frames += outcome.frames
            else:
                self._failed_frames += outcome.frames

    def run(self, frames: Mapping[str, int]) -> None:
        """Set the frames that are done, by id of the running log; frames of failed attempts drop out."""
        self._running = frames

    def rest_s(self) -> float | None:
        """Remaining time at the pace since the start, s; None before the first frame, or if no log has a
        known length."""
        made, frames = self._made_frames + self._running_frames(), self.frames
        if made <= 0 or frames is None:
            return None
        return (time.monotonic() - self._begun_s) / made * (frames - self.frames_done)

    def _running_frames(self) -> int:
        """Frames of running logs so far."""
        return sum(min(n, self._known.get(i, n)) for i, n in self._running.items())

    def line(self) -> str:
        """All counts in one line."""
        rest_s = self.rest_s()
        rest = "" if rest_s is None or not self.left else f"; about {duration(rest_s)} left"
        return (
            f"{self.done} done, {self.failed} failed, {self.left} left; "
            f"{frames_of(self.frames_done, self.frames)}{rest}"
        )


def frames_of(done: int, frames: int | None) -> str:
    """As `300 of 450 frames`; `300 frames` if the frames of all logs are not known."""
    return f"{done} frames" if frames is None else f"{done} of {frames} frames"


def duration(seconds: float) -> str:
    """As `2 h 10 min`, `3 min`, `20 s`."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"
