"""Every n-th of the frames of a run, for meshes, images and consistency."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import count, islice

from hsslam_node.frame import Frame
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.source import BadFrame, Source, frames_in_time


@dataclass(frozen=True)
class EveryNth:
    """Every n-th frame of a source from `first` on; the source does not decode the others if it can skip
    frames."""

    source: Source
    every: int = 1
    first: int = 0

    @classmethod
    def of_run(
        cls,
        open_it: Callable[[SourceOptions], Source],
        options: SourceOptions,
        every: int,
        first: int = 0,
    ) -> "EveryNth":
        """Every n-th of the frames that a run with these options reads, with the stamps that they have there.

        Repeated frames and a covered lens are counted over all frames of the run. Noise depends on the
        number of a frame among the chosen ones.
        """
        if options.reorders or options.cover_frames or first:
            return cls(open_it(options), every, first)
        limit = None if options.frames is None else -(-options.frames // every)
        return cls(open_it(replace(options, stride=options.stride * every, frames=limit)))

    def __iter__(self) -> Iterator[Frame | BadFrame]:
        turn = count(-self.first)
        items = frames_in_time(self.source, 0, lambda *_: next(turn) % self.every > 0)
        return islice(items, self.first, None, self.every)

    @property
    def count(self) -> int | None:
        """Number of these frames; None: unknown."""
        frames = self.source.frame_count
        return None if frames is None else -(-max(frames - self.first, 0) // self.every)
