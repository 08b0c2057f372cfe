"""The frames of a log, each once and not decoded, from any of them on."""

import bisect
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from hsslam_proto import messages
from hsslam_proto.frame_order import FrameOrder
from hsslam_proto.topics import FRAME
from hsslam_services.log.reading.reader import BEGINNING, ChunkPlace, bus_messages

_APART = 100  # frames between two known places


@dataclass
class _Known:
    """A place in the log at which reading can begin, and what the frames before it tell; `row`: their number.

    `camera`, `newest`: publisher and index of the last of them. `shift`: what is added to indices in the log.
    """

    place: ChunkPlace = BEGINNING
    row: int = 0
    order: FrameOrder = field(default_factory=FrameOrder)
    camera: int | None = None
    newest: int = -1
    shift: int = 0

    def take(self, message: messages.Frame) -> messages.Frame | None:
        """The next frame, with its index in the source; None if it is not new."""
        place = self.order.place(message.publisher, message.index, message.stamp_ns)
        if place.kind == "old":
            return None
        self.order.take(place)
        begins = place.publisher != self.camera or place.kind == "absurd"
        if self.camera is not None and begins:
            self.shift = self.newest + 1 - message.index
        self.camera, self.newest = place.publisher, self.shift + message.index
        self.row += 1
        if self.shift:
            return msgspec.structs.replace(message, index=self.newest, publisher=self.camera)
        return message


class LoggedFrames:
    """The frames in the files of a log; indices of a further camera continue after those of the last, and so
    do those of a camera whose count has jumped.

    Notes a place every 100 frames while it reads; a later reading begins at the last before its first frame.
    """

    def __init__(self, files: list[Path]) -> None:
        self._files = files
        self._known = [_Known()]

    def since(self, first: int = 0) -> Iterator[tuple[int, messages.Frame]]:
        """Each frame from number `first` on, with its number.

        Raises:
            UserError: the log is damaged.
        """
        at = bisect.bisect_right(self._known, first, key=lambda known: known.row) - 1
        known = deepcopy(self._known[at])
        place: ChunkPlace | None = known.place
        for logged in bus_messages(self._files, {FRAME.name}, known.place):
            if logged.chunk != place:
                place = logged.chunk
                self._note(known, place)
            message = logged.message()
            assert isinstance(message, messages.Frame)
            row, frame = known.row, known.take(message)
            if frame is not None and row >= first:
                yield row, frame

    def _note(self, known: _Known, place: ChunkPlace | None) -> None:
        if place is not None and known.row >= self._known[-1].row + _APART:
            known.place = place
            self._known.append(deepcopy(known))
