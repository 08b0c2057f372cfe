"""When the recorder asks for all blocks of the mesh again, and which of those that come are drawn again."""

from pathlib import Path

from hsslam_proto.envelope import Envelope
from hsslam_proto.mesh.messages import MeshBlocks
from hsslam_proto.message import Message

_EVERY_S = 600.0  # a viewer that comes late finds all blocks in the log near its time


class WholeMesh:
    """A part of the log opens alone, so it needs the blocks that were sent before it as well.

    So does run.<k>.rrd beside it. A web viewer that connects late needs them, too, once its server has
    forgotten the oldest data.

    Args:
        part: of the log that is written now.
        now_s: monotonic clock, s.
    """

    def __init__(self, part: Path, now_s: float) -> None:
        self._part = part
        self._asked_s = self._drawn_s = now_s
        self._has_asked = self._is_drawn_again = self._is_in_file = False

    def is_due(self, part: Path, now_s: float) -> bool:
        """Whether to ask for all blocks now; `part`: of the log that is written now."""
        if part == self._part and now_s - self._asked_s < _EVERY_S:
            return False
        self._is_in_file = part == self._part
        self._part, self._asked_s, self._has_asked = part, now_s, True
        self._is_drawn_again = now_s - self._drawn_s >= _EVERY_S
        if self._is_drawn_again:
            self._drawn_s = now_s
        return True

    def is_for_file(self, message: Message, envelope: Envelope | None) -> bool:
        """Whether the file for rerun takes the message: answers, which have no envelope, fill a new file."""
        return not (_is_answer(message, envelope) and self._is_in_file)

    def is_for_viewer(self, message: Message, envelope: Envelope | None) -> bool:
        """Whether a viewer draws the message: it draws what it has again only now and then."""
        is_repeated = _is_answer(message, envelope) and self._has_asked
        return self._is_drawn_again or not is_repeated


def _is_answer(message: Message, envelope: Envelope | None) -> bool:
    return isinstance(message, MeshBlocks) and envelope is None
