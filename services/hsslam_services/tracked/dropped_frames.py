"""The frames of a run without a pose, counted in a file of its own in the arena: restarts go on counting."""

import contextlib
import os
import struct
from collections.abc import Mapping
from pathlib import Path

from hsslam_proto.envelope import Envelope

_LAYOUT = struct.Struct("<qqq")
_FILE = "dropped_frames"


class DroppedFrames:
    """Frames that the trackers of a run dropped, or that came while there was none.

    `count`: their number; `took` saves it. `awaited`: the next sequence number by publisher, after the last
    frame that an earlier tracker took.
    """

    def __init__(self, arena_dir: Path) -> None:
        self._fd = os.open(arena_dir / _FILE, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        saved = os.pread(self._fd, _LAYOUT.size, 0)
        self.count, self._publisher, self._next = _LAYOUT.unpack(saved) if saved else (0, 0, 0)
        self.awaited: Mapping[int, int] = {self._publisher: self._next} if self._next else {}

    def took(self, envelope: Envelope | None) -> None:
        """Save the count so far, and that the tracker is done with this frame; None: it has no number."""
        if envelope is not None:
            self._publisher, self._next = envelope.publisher, envelope.sequence + 1
        with contextlib.suppress(OSError):  # the memory is full: the older count stays
            os.pwrite(self._fd, _LAYOUT.pack(self.count, self._publisher, self._next), 0)
