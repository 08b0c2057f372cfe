"""A few frames of a source: short runs of consecutive ones, spread over the sequence."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hsslam_node.frame import Frame
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.reports import Report, reports_of
from hsslam_node.sources.source import BadFrame, NoFrame, Source, SourceLostError

RUN_FRAMES = 3


@dataclass(frozen=True)
class Sample:
    """The sampled frames; the `index` of a good or bad frame is its place in `rows`."""

    name: str
    frame_count: int | None
    rows: tuple[int, ...]  # numbers within the source
    frames: tuple[Frame, ...]
    bad: tuple[BadFrame, ...]
    reports: tuple[Report, ...] = ()  # of other faults of the source
    silence: str = ""  # why a live camera sent no more frames; "": it did

    @property
    def spread(self) -> list[Frame]:
        """One frame of each run."""
        starts = {i for i, row in enumerate(self.rows) if i == 0 or row != self.rows[i - 1] + 1}
        if len(starts) < len(self.frames) / (2 * RUN_FRAMES):  # one long run: every third
            starts = set(range(0, len(self.rows), RUN_FRAMES))
        return [frame for frame in self.frames if frame.index in starts]

    @property
    def pairs(self) -> list[tuple[Frame, Frame]]:
        """Consecutive frames of the source."""
        return [
            (a, b)
            for a, b in itertools.pairwise(self.frames)
            if b.index == a.index + 1 and self.rows[b.index] == self.rows[a.index] + 1
        ]

    @property
    def intervals_ns(self) -> np.ndarray:
        """Times between consecutive frames, readable or not, [N] int64 ns."""
        stamps = {item.index: item.stamp_ns for item in (*self.frames, *self.bad)}
        found = [
            stamps[i + 1] - stamps[i]
            for i in range(len(self.rows) - 1)
            if self.rows[i + 1] == self.rows[i] + 1 and i in stamps and i + 1 in stamps
        ]
        return np.array(found, np.int64)


def take_sample(
    spec: str,
    options: SourceOptions,
    frames: int,
    open_it: Callable[[str, SourceOptions], Source] = open_source,
) -> Sample:
    """At most `frames` frames of the source that `open_it` makes of `spec`.

    A live source, whose length is unknown, gives its first frames, until it is silent for seconds.

    Raises:
        UserError: as `open_source`.
    """
    spread = _SpreadRows(**vars(options), most=frames)
    source = open_it(spec, spread)
    if spread.found:
        (count,) = spread.found
        return _read(source, count, _sample_rows(count, frames))
    count = source.frame_count
    return _read(source, count, tuple(range(frames if count is None else min(count, frames))))


def _read(source: Source, count: int | None, rows: tuple[int, ...]) -> Sample:
    read: list[Frame | BadFrame] = []
    silence = ""
    try:
        for item in itertools.islice(source.frames(), len(rows)):
            if isinstance(item, NoFrame):
                silence = item.reason
                break
            read.append(item)
    except SourceLostError as error:
        silence = str(error)
    frames = tuple(replace(f, index=i) for i, f in enumerate(read) if isinstance(f, Frame))
    bad = tuple(replace(f, index=i) for i, f in enumerate(read) if isinstance(f, BadFrame))
    reports = tuple(reports_of(source).take())
    return Sample(source.name, count, rows[: len(read)], frames, bad, reports, silence)


def _sample_rows(count: int, frames: int) -> tuple[int, ...]:
    """Numbers of the frames to sample, of `count`: all, or runs spread over all."""
    if count <= frames:
        return tuple(range(count))
    runs = max(frames // RUN_FRAMES, 1)
    starts = np.linspace(0, max(count - RUN_FRAMES, 0), runs).astype(int)
    rows = {int(start) + i for start in starts for i in range(min(RUN_FRAMES, frames))}
    return tuple(sorted(rows))


@dataclass(frozen=True)
class _SpreadRows(SourceOptions):
    """Options that sample `most` of the frames that the plain options select.

    `found`: number of these, once a source calls `selected`; live ones do not.
    """

    most: int = 0
    found: list[int] = field(default_factory=list)

    def selected(self, count: int) -> Sequence[int]:
        chosen = super().selected(count)
        self.found[:] = [len(chosen)]
        return [chosen[row] for row in _sample_rows(len(chosen), self.most)]
