"""The frames of a source in another order: a camera that is carried away, or comes back."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.sources.source import BadFrame, Source


class Reordered:
    """A source whose n-th frame is frame `order[n]` of another, with stamps that run on.

    Indices and stamps are those of a camera that never stopped. Frames out of turn stay in memory
    until their last use.

    Raises:
        UserError: the other source has fewer frames.
    """

    def __init__(self, source: Source, order: Sequence[int]) -> None:
        if source.frame_count is not None and order and max(order) >= source.frame_count:
            raise UserError(
                f"source {source.name}: frame {max(order)}: expected one of {source.frame_count}"
            )
        self._source = source
        self._order = tuple(order)
        self.name = f"{source.name} reordered"
        self.camera = source.camera
        self.rate_hz = source.rate_hz
        self.frame_count: int | None = len(self._order)
        self.depth_units_per_m = source.depth_units_per_m

    def frames(self, first: int = 0) -> Iterator[Frame | BadFrame]:
        """The frames in the new order; an unreadable one stays a `BadFrame`."""
        order = self._order[first:]
        last_use = {k: n for n, k in enumerate(order, first)}
        earliest = min(order, default=0)
        kept: dict[int, Frame | BadFrame] = {}
        arriving = enumerate(self._source.frames(earliest), earliest)
        for n, wanted in enumerate(order, first):
            while wanted not in kept:
                at, frame = next(arriving, (None, None))
                if at is None or frame is None:
                    raise UserError(f"source {self._source.name}: ended before frame {wanted}")
                if at in last_use:
                    kept[at] = frame
            frame = kept[wanted] if last_use[wanted] > n else kept.pop(wanted)
            yield replace(frame, index=n, stamp_ns=round(n * 1e9 / self.rate_hz))
