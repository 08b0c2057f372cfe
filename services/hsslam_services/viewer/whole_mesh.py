"""When the recorder asks for all blocks of the mesh again, and which of those that come are drawn again."""

from pathlib import Path

from hsslam_proto.envelope import Envelope
from hsslam_proto.mesh.blocks_message import MeshBlocks
from hsslam_proto.messages import Message

_EVERY_S = 600.0  # a viewer that comes late finds all blocks in the log near its time


class WholeMesh:
    """A part of the log opens alone, so it needs the blocks that were sent before it as well.

    A web viewer that connects late needs them, too, once its server has forgotten the oldest data.

    Args:
        part: of the log that is written now.
        now_s: monotonic clock, s.
    """

    def __init__(self, part: Path, now_s: float) -> None:
        self._part = part
        self._asked_s = self._drawn_s = now_s
        self._has_asked = self._is_drawn_again = False

    def is_due(self, part: Path, now_s: float) -> bool:
        """Whether to ask for all blocks now; `part`: of the log that is written now."""
        if part == self._part and now_s - self._asked_s < _EVERY_S:
            return False
        self._part, self._asked_s, self._has_asked = part, now_s, True
        self._is_drawn_again = now_s - self._drawn_s >= _EVERY_S
        if self._is_drawn_again:
            self._drawn_s = now_s
        return True

    def is_repeated(self, message: Message, envelope: Envelope | None) -> bool:
        """Whether run.rrd has the message. Answers have no envelope; the first filled an empty run.rrd."""
        return isinstance(message, MeshBlocks) and envelope is None and self._has_asked

    def is_to_draw(self, message: Message, envelope: Envelope | None) -> bool:
        """Whether a viewer draws the message; what it has it draws again only now and then."""
        return self._is_drawn_again or not self.is_repeated(message, envelope)
